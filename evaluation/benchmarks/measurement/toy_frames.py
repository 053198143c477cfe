"""Frames of the procedural subject, with their true caricatures, for the benchmarks of targets and images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from carigs.capture import Camera, Capture, Frame, read_dataset
from carigs.exaggeration import Caricature
from carigs.gtstar import Target, make_target
from carigs.head import neutral, pose, subject_gamma_path
from carigs.head.teeth import add_teeth
from carigs.raster import compute_visibility
from carigs.settings import Exaggerate, Gtstar, Toy
from carigs.toy import load_subject, render_subject, write_capture

SIZE = (550, 802)
"""Width and height of enlarged images, those of the paper."""


def write_subject(folder: Path, toy: Toy, exaggerate: Exaggerate | None = None) -> None:
    """Write a capture of the procedural subject and its path, as the stages `capture` and `exaggerate` do.

    Args:
        folder: Folder for `capture.json`, `path.npz` and the dataset.
        toy: Settings of the subject.
        exaggerate: Settings of the path; None for the defaults.
    """
    write_capture(folder / "dataset", toy)
    write_index_and_path(folder, folder / "dataset", folder / "dataset/head_model.npz", exaggerate)


def write_index_and_path(folder: Path, dataset: Path, model: Path, exaggerate: Exaggerate | None = None) -> None:
    """Index a dataset and exaggerate its head, as the stages `capture` and `exaggerate` do.

    Args:
        folder: Folder for `capture.json` and `path.npz`.
        dataset: The dataset.
        model: File of its head model.
        exaggerate: Settings of the path; None for the defaults.
    """
    read_dataset(dataset, model).save(folder / "capture.json")
    subject = Capture.load(folder / "capture.json")
    parameters = [subject.parameters(t) for t in dict.fromkeys(frame.timestep for frame in subject.frames)]
    vertices = neutral(subject.model, parameters[0])
    path = subject_gamma_path(subject.model, vertices, exaggerate or Exaggerate(), parameters)
    add_teeth(path, vertices, subject.model.faces).save(folder / "path.npz")


def caricature_scenes(subject: Capture, frames: Sequence[Frame], exaggerated: Caricature) -> list[tuple]:
    """Read frames, and render their true caricatures.

    Args:
        subject: Capture of the procedural subject.
        frames: Some of its frames.
        exaggerated: The caricature.

    Returns:
        Image, matte, natural and caricature mesh, camera, true caricature and its matte, of each frame.
    """
    person, model, scenes = load_subject(subject.root), subject.model, []
    for frame in frames:
        parameters, camera = subject.parameters(frame.timestep), subject.camera(frame)
        meshes = pose(model, parameters), pose(model, parameters, exaggerated)
        truth = render_subject(person, parameters, camera, exaggerated)
        scenes.append((subject.image(frame), subject.foreground(frame), *meshes, camera, *truth))
    return scenes


def warp_scene(
    subject: Capture, face_flags: np.ndarray, settings: Gtstar, image: np.ndarray, matte: np.ndarray,
    natural: np.ndarray, deformed: np.ndarray, camera: Camera,
) -> Target:  # fmt: skip
    """Warp a frame from the natural mesh to that of the caricature.

    Args:
        subject: Its capture.
        face_flags: Flags of the triangles.
        settings: Options of the warp.
        image: The frame.
        matte: Its foreground.
        natural: Vertices of the natural head.
        deformed: Vertices of the caricature.
        camera: The camera.

    Returns:
        The target, not relit.
    """
    ends = [compute_visibility(vertices, subject.model.faces, camera) for vertices in (natural, deformed)]
    return make_target(image, matte, *ends, subject.model, face_flags, settings, subject.background)


def enlarged(camera: Camera) -> Camera:
    """Change the resolution of a camera.

    Args:
        camera: The camera.

    Returns:
        The same view in an image of `SIZE`.
    """
    scaled = camera.scaled(SIZE[1] / camera.height)
    return Camera(scaled.camera_from_world, scaled.fx, scaled.fy, 0.5 * SIZE[0], 0.5 * SIZE[1], *SIZE)
