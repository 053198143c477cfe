"""A video of one person becomes a dataset: landmarks, solver, mattes, and what is to be said about the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from threadpoolctl import threadpool_limits

from carigs.capture.dataset_writer import check_target
from carigs.capture.images import write_png
from carigs.detection import FaceTrack, collect, follow_face, load_face_networks
from carigs.detection.mesh_indices import COUNT, REGIONS
from carigs.detection.person import load_person_segmenter
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.footage import Footage, Selection, read_video
from carigs.footage.measures import FrameMeasures, measure_frames
from carigs.head import HeadModel, neutral, pose
from carigs.matting import matted_frames
from carigs.matting.closed_form import pymatting
from carigs.settings import Track
from carigs.tracking.advice import advice
from carigs.tracking.contact_sheet import Overlay, contact_sheet, frames_to_show
from carigs.tracking.dataset import tracked_camera, write_tracked_dataset
from carigs.tracking.error_table import error_table
from carigs.tracking.footage_tracking import FootageTrack, track_footage
from carigs.tracking.held_out import SPLITS
from carigs.tracking.quality import TrackedFrames, face_sharpness, head_angles, openings
from carigs.tracking.video_frames import chosen_frames

SHEET, TABLE = "tracking.png", "tracking.txt"
"""Files of the dataset that say how well the head was tracked."""

Progress = Callable[[Iterable, str, int], Iterable]
"""Shows how far an iteration is: iterable, name, number of items."""


@dataclass(frozen=True)
class VideoReport:
    """What is to be said of a tracked video."""

    focal_length: float
    """Pixels."""
    focal_guess: float
    frames: int
    tracked: int
    errors: str
    """Table of the errors by region."""
    advice: tuple[str, ...]


def track_video(
    settings: Track,
    folder: Path,
    *,
    weights: Path | None = None,
    progress: Progress = lambda items, name, count: items,
    status: Callable[[str], AbstractContextManager] = nullcontext,
) -> VideoReport:
    """Track the head of a person before one static camera, and write a dataset.

    Args:
        settings: The video, the head model, and how they are read.
        folder: Dataset to create.
        weights: Folder of weights that is searched first.
        progress: Wraps iterations over frames.
        status: Makes a context that shows what is done in it.

    Returns:
        What is to be said. The dataset holds the same as a picture and a table.

    Raises:
        CarigsError: If a package or the weights are not there, the folder is not empty, or the video cannot be used.
    """
    check_target(folder)
    pymatting()  # before work starts
    networks, segmenter = load_face_networks(weights), load_person_segmenter(weights)
    model = HeadModel.load(settings.head_model)
    points, numbers = read_embedding(settings.embedding and Path(settings.embedding), model, COUNT)
    video = Path(settings.video)
    footage = chosen_frames(video, settings.frame_rate, settings.largest_side)
    count = len(footage)
    faces = collect(progress(follow_face(footage.decode(), networks), "landmarks", count))
    measures = measure_frames(footage)
    focal = settings.focal_length
    if focal:
        focal *= footage.width / read_video(video, Selection(max_frames=1)).width
    with status("fitting the head"), threadpool_limits(1, "blas"):  # the same bytes with any number of cores
        track = track_footage(footage, faces, measures, model, points, numbers, focal_length=focal)
    chin = float(points.interpolate(neutral(track.head.model, track.head.parameters[0]))[:, 1].min())
    matted = matted_frames(footage, lambda frame: segmenter(frame.image))
    write_tracked_dataset(
        folder,
        track,
        footage,
        progress(matted, "mattes", count),
        background=settings.background,
        chin=chin if settings.body == "cut" else None,
        splits=SPLITS[settings.held_out],
    )
    frames = tracked_frames(footage, track, faces, measures, numbers)
    table = error_table(frames)
    write_png(folder / SHEET, _sheet(footage, track, frames) / 255.0)
    lines = tuple(advice(frames))
    (folder / TABLE).write_text("\n".join([table, *lines, ""]), "utf-8")
    focal_length = float(track.head.cameras.focal[0])
    return VideoReport(focal_length, track.focal_guess, count, len(track.kept), table, lines)


def tracked_frames(
    footage: Footage,
    track: FootageTrack,
    faces: FaceTrack,
    measures: FrameMeasures,
    numbers: np.ndarray,
) -> TrackedFrames:
    """Put together what advice and tables need.

    Args:
        footage: The frames.
        track: The tracked head.
        faces: The landmarks.
        measures: Measures of the frames.
        numbers: Which of the detector's landmarks the tracker uses.

    Returns:
        Values of all frames.
    """
    count, kept, head = len(footage), track.kept, track.head

    def filled(values: np.ndarray) -> np.ndarray:
        found = np.full(count, np.nan)
        found[kept] = values
        return found

    reasons = np.full(count, "", object)
    for reason, positions in track.left_out.items():
        reasons[positions] = reason
    camera = tracked_camera(track, footage)
    model = head.model
    vertices = [pose(model, parameters) for parameters in head.parameters]
    skull = np.flatnonzero(neutral(model, head.parameters[0])[:, 1] > np.median(model.v_template[:, 1]))
    frame_axes = np.stack([_axes(v[skull], model.v_template[skull]) for v in vertices])
    yaw, pitch = head_angles(camera.camera_from_world[:3, :3] @ frame_axes)
    outside = []
    for v in vertices:
        pixels, _ = camera.project(v[skull])
        inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        outside.append(1 - inside.mean())
    mouth, eyes = openings(faces.landmarks[kept].astype(np.float64))
    errors = {
        name: filled(head.errors[:, 0, np.isin(numbers, members)].mean(axis=1))
        for name, members in REGIONS.items()
        if np.isin(numbers, members).any()
    }
    boxes = np.nan_to_num(faces.boxes)
    sharpness = [face_sharpness(image, tuple(box)) for image, box in zip(footage.decode(), boxes, strict=True)]
    return TrackedFrames(
        np.array(footage.numbers),
        footage.times,
        tuple(reasons),
        filled(yaw),
        filled(pitch),
        errors,
        filled(faces.boxes[kept, 2] - faces.boxes[kept, 0]),
        filled(np.array(outside)),
        filled(mouth),
        filled(eyes),
        filled(np.array(sharpness)[kept]),
        measures.exposure,
    )


def _axes(posed: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Rotation of the skull (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((posed - posed.mean(axis=0)).T @ (rest - rest.mean(axis=0)))
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt


def _sheet(footage: Footage, track: FootageTrack, frames: TrackedFrames) -> UInt8[np.ndarray, "h w 3"]:
    """Worst and typical frames with the mesh and the landmarks."""
    worst, typical = frames_to_show(frames)
    chosen = sorted({*worst, *typical})
    position = {int(k): t for t, k in enumerate(track.kept)}
    camera = tracked_camera(track, footage)
    overlays = {}
    for k, image in _images(footage, chosen):
        t = position[k]
        vertices, _ = camera.project(pose(track.head.model, track.head.parameters[t]))
        overlays[k] = Overlay(image, vertices, track.landmarks[t], track.head.projected[t, 0])
    return contact_sheet(frames, overlays, track.head.model.faces, str(footage.source.name))


def _images(footage: Footage, chosen: list[int]) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
    """Some of the frames, by position."""
    wanted = set(chosen)
    for k, image in enumerate(footage.decode()):
        if k in wanted:
            yield k, image
