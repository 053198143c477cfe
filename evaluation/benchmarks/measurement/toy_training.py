"""Whole trainings on the procedural subject, and their PSNR against captured frames and true caricatures."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Camera, Capture, Frame
from carigs.capture.target_index import TargetSet, read_targets, write_targets
from carigs.exaggeration import Caricature, GammaPath
from carigs.gtstar.target_set import make_target_set
from carigs.hair import FoundHair, find_hair
from carigs.head import neutral, pose
from carigs.raster import rasterize_mesh
from carigs.settings import Exaggerate, Gtstar, Hair, Toy, Train
from carigs.splat.avatar import Avatar
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.trainer import train_surfels
from carigs.toy import load_subject, render_subject
from evaluation.benchmarks.measurement.toy_frames import write_subject
from evaluation.metrics.image_quality import psnr_of_errors, squared_error
from evaluation.metrics.regions import SurfaceRegions, image_regions, surface_regions

BAND = 2
"""Half width of the region `silhouette` in pixels, as in the stage `metrics`."""


class TrainingInputs(NamedTuple):
    """What the stage `train` reads."""

    capture: Capture
    path: GammaPath
    hair: FoundHair
    targets: TargetSet


class HeldOutView(NamedTuple):
    """A test frame at a level, with its true image."""

    frame: Frame
    camera: Camera
    truth: Float[np.ndarray, "h w 3"]
    regions: dict[str, Bool[np.ndarray, "h w"]]


def make_inputs(folder: Path, toy: Toy, exaggerate: Exaggerate, gtstar: Gtstar) -> TrainingInputs:
    """Make capture, path, hair and GT* targets at gamma, as the stages do.

    Args:
        folder: Empty folder to write to.
        toy: Settings of the subject.
        exaggerate: Settings of the path.
        gtstar: Settings of the targets.

    Returns:
        What a training reads.
    """
    write_subject(folder, toy, exaggerate)
    return inputs_of(folder, gtstar)


def inputs_of(folder: Path, gtstar: Gtstar, threads: int = 1) -> TrainingInputs:
    """Find the hair and make GT* targets at gamma, as the stages do.

    Args:
        folder: Folder with `capture.json` and `path.npz`, to which the targets are written.
        gtstar: Settings of the targets.
        threads: Threads of both.

    Returns:
        What a training reads.
    """
    capture, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
    images, records, index = folder / "targets", folder / "records", folder / "targets.json"
    images.mkdir()
    records.mkdir()
    with ThreadPoolExecutor(threads) as pool:
        hair = find_hair(Hair(regions=gtstar.regions), capture, pool.map)
    entries = make_target_set(gtstar, capture, path.at(path.gamma_f), images, records, hair, threads)
    write_targets(index, path.gamma_f, images, *entries)
    return TrainingInputs(capture, path, hair, read_targets(index, capture))


def train_avatar(inputs: TrainingInputs, settings: Train) -> Avatar:
    """Train an avatar as the stage `train` does.

    Args:
        inputs: What it is trained on.
        settings: Settings of the training.

    Returns:
        The avatar.
    """
    capture, path, hair, targets = inputs
    subject = prepare_subject(capture, path, settings, hair, [targets])
    surfels, _ = train_surfels(settings, subject)
    return Avatar(surfels, subject.sequence, settings.rig, settings.rotate_harmonics, capture.background)


def held_out_views(inputs: TrainingInputs, level: float) -> list[HeldOutView]:
    """The test frames of the subject at a level.

    Args:
        inputs: The subject.
        level: Exaggeration: the true images of 0 are the captured frames, those of others are rendered.

    Returns:
        The frames with their true images and regions.
    """
    capture, model, views = inputs.capture, inputs.capture.model, []
    caricature, person = inputs.path.at(level), load_subject(capture.root)
    surface = surface_regions(model, neutral(model, capture.parameters(capture.frames[0].timestep)))
    for frame in capture.split("test"):
        parameters, camera = capture.parameters(frame.timestep), capture.camera(frame)
        if level == 0:
            truth, matte = capture.image(frame), capture.foreground(frame)
        else:
            truth, matte = render_subject(person, parameters, camera, caricature)
        views.append(held_out_view(capture, frame, caricature, surface, in_eight_bits(truth), matte))
    return views


def held_out_view(
    capture: Capture,
    frame: Frame,
    caricature: Caricature,
    surface: SurfaceRegions,
    truth: Float[np.ndarray, "h w 3"],
    matte: Float[np.ndarray, "h w"],
) -> HeldOutView:
    """Find the regions of a test frame.

    Args:
        capture: The capture.
        frame: The frame.
        caricature: The head at the level of the true image.
        surface: Regions of the subject's surface.
        truth: The true image.
        matte: Its foreground.

    Returns:
        The frame with its true image and regions.
    """
    camera, faces = capture.camera(frame), capture.model.faces
    vertices = pose(capture.model, capture.parameters(frame.timestep), caricature)
    seen = rasterize_mesh(vertices, faces, camera)
    return HeldOutView(frame, camera, truth, image_regions(surface, vertices, seen, camera, matte > 0.5, band=BAND))


def psnr_by_region(avatar: Avatar, level: float, views: Sequence[HeldOutView]) -> dict[str, float]:
    """Mean PSNR of each region over the frames that show it.

    Args:
        avatar: The avatar.
        level: Level to render.
        views: Frames at this level.

    Returns:
        PSNR in dB by region.
    """
    values: dict[str, list[float]] = {}
    for frame, camera, truth, regions in views:
        error = squared_error(in_eight_bits(avatar.render(frame.timestep, level, camera)), truth)
        for region, inside in regions.items():
            if inside.any():
                values.setdefault(region, []).append(psnr_of_errors(error[inside]))
    return {region: float(np.mean(of_frames)) for region, of_frames in values.items()}


def in_eight_bits(image: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """Round an image as its PNG file does.

    Args:
        image: Values in [0, 1].

    Returns:
        Multiples of 1/255.
    """
    return np.rint(np.clip(image, 0, 1) * 255) / 255
