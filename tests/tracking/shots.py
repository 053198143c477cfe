"""Recordings whose faces and rooms are told, without images and networks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from carigs.detection import FaceTrack
from carigs.detection.likeness import COLOURS
from carigs.detection.mesh_indices import COUNT
from carigs.footage import Footage
from carigs.footage.measures import THUMBNAIL, FrameMeasures
from carigs.tracking.recording import Recording

WIDTH, HEIGHT = 640, 480


def recording(
    presence: Sequence[float] | np.ndarray,
    *,
    cuts: Sequence[int] = (),
    jumped: Sequence[int] = (),
    rooms: Sequence[int] | np.ndarray | None = None,
    people: Sequence[int] | np.ndarray | None = None,
    shift: Sequence[float] | np.ndarray | None = None,
    name: str = "me.mp4",
) -> Recording:
    """What a camera recorded.

    Args:
        presence: Probability of the face in each frame.
        cuts: Frames whose layout differs from that of the frame before.
        jumped: Frames in which the face is elsewhere than before.
        rooms: The room that each frame shows; one for all by default.
        people: The person whose face each frame shows.
        shift: How far the face is to the left, in pixels.
        name: Of the file.

    Returns:
        The recording.
    """
    count = len(presence)
    numbers, times, ones = np.arange(count), np.arange(count) / 25, np.ones(count)
    rooms, people = (np.zeros(count, int) if of is None else np.asarray(of, int) for of in (rooms, people))
    landmarks = np.zeros((count, COUNT, 3), np.float32)
    landmarks[:, :, :2] = np.random.default_rng(5).uniform((270, 190), (370, 290), (COUNT, 2))
    landmarks[:, :, 0] -= np.zeros((count, 1)) if shift is None else np.reshape(shift, (-1, 1))
    landmarks[np.asarray(presence) == 0] = np.nan
    boxes = np.concatenate([landmarks[:, :, :2].min(axis=1), landmarks[:, :, :2].max(axis=1)], axis=1)
    colours = np.random.default_rng(1).normal(size=(people.max() + 1, COLOURS))[people]
    colours = colours / np.linalg.norm(colours, axis=1, keepdims=True)
    faces = FaceTrack(
        landmarks, np.array(presence, np.float32), boxes, np.ones(count, int), np.isin(numbers, jumped),
        np.where(np.asarray(presence)[:, None] > 0, colours, np.nan).astype(np.float32),
    )  # fmt: skip
    images = np.random.default_rng(2).integers(0, 256, (rooms.max() + 1, THUMBNAIL, THUMBNAIL, 3), np.uint8)[rooms]
    layout = np.where(np.isin(numbers, cuts), 0.9, 0.001)
    measures = FrameMeasures(times, ones, 0 * ones, np.zeros((count, 2)), ones, layout, 0 * ones, images)
    footage = Footage(
        Path(name), WIDTH, HEIGHT, tuple(numbers.tolist()), times, 25.0, count / 25, None, lambda: iter(())
    )
    return Recording(footage, faces, measures)
