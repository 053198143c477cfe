"""The dataset of tracked footage: frames with mattes, cameras, head parameters and the person's head model."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Int

from carigs.capture import Camera, Capture, Frame
from carigs.capture.dataset_writer import parameter_file, write_dataset
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.images import write_png
from carigs.capture.splits import blocks
from carigs.head import SurfacePoints, neutral, pose
from carigs.matting import MattedFrame, composite
from carigs.system.in_order import in_order
from carigs.tracking.eyeballs import lids_before_eyeballs
from carigs.tracking.footage_tracking import FootageTrack
from carigs.tracking.held_out import held_out
from carigs.tracking.outline.outline_offset import OutlineView, outline_offset
from carigs.tracking.recording import Recording
from carigs.tracking.skin.edges import EDGES, LIDS, edge_expressions
from carigs.tracking.skin.face_chart import UnwrappedFrame, face_chart
from carigs.tracking.skin.own_expressions import own_expressions
from carigs.tracking.torso.neck_bend import bend_with_torso
from carigs.tracking.torso.torso_motion import TorsoView, torso_view

OUTLINE_VIEWS = 24
"""Training frames whose outline is compared with the head's."""
CHART_SIDE = 224
"""Pixels along the sides of the chart in which the movement of the skin is found."""
THREADS = 2
"""That write frames."""


def write_tracked_dataset(
    folder: Path,
    track: FootageTrack,
    recordings: Sequence[Recording],
    matted: Iterable[MattedFrame],
    *,
    background: float,
    landmarks: SurfacePoints,
    numbers: Int[np.ndarray, " n"],
    by_time: Callable[[int], list[str]] = blocks,
) -> FootageTrack:
    """Write tracked footage as a dataset that studies read.

    The head gets the outline that the mattes show, and the person's own expressions.

    Args:
        folder: Folder to create.
        track: The tracked head.
        recordings: The frames.
        matted: Those that are tracked, with mattes, in order, recording after recording.
        background: Grey value that frames are composited on.
        landmarks: Points of the face, which has the colour of the skin.
        numbers: Which of the detector's landmarks these are.
        by_time: Names the split of each tracked timestep of a clip.

    Returns:
        The track with the head as it was written.

    Raises:
        InputError: If the folder holds something.
    """
    cameras = tracked_cameras(track, recordings)
    frames_folder = folder.parent / f".{folder.name}.frames"
    shutil.rmtree(frames_folder, ignore_errors=True)
    frames_folder.mkdir(parents=True)
    head, model, parameters = track.head, track.head.model, track.head.parameters
    rest = neutral(model, parameters[0])
    chart = None if track.one_moment else face_chart(model, rest, CHART_SIDE)
    names = tracked_splits(track, cameras, by_time)
    places = list(product(range(len(track.cameras)), range(len(track.kept))))
    looked_at = {*evenly_spread([(c, t) for c, t in places if names[t][c] == "train"], OUTLINE_VIEWS)}
    views, skin = list[OutlineView](), list[UnwrappedFrame]()
    torsos: list[list[TorsoView]] = [[] for _ in track.kept]

    def write(
        item: tuple[tuple[int, int], MattedFrame],
    ) -> tuple[tuple[int, int], MattedFrame, UnwrappedFrame | None, TorsoView | None]:
        """Write a frame with its matte, and take skin and torso out of it."""
        (c, t), (frame, alpha, foreground) = item
        posed = pose(model, parameters[t])
        unwrapped = None if chart is None else chart.unwrap(frame.image, alpha, posed, cameras[c])
        torso = torso_view(foreground, alpha, posed, model.faces, cameras[c]) if not track.one_moment else None
        write_png(frames_folder / f"{t:05d}_{c:02d}.png", composite(foreground, alpha, background) / 255.0)
        write_png(frames_folder / f"{t:05d}_{c:02d}_matte.png", alpha)
        return (*item, unwrapped, torso)

    try:
        for (c, t), (frame, alpha, _), unwrapped, torso in in_order(write, zip(places, matted, strict=True), THREADS):
            if (c, t) in looked_at:
                views.append(OutlineView(cameras[c], head.parameters[t], frame.image, alpha))
            if unwrapped is not None:
                skin.append(unwrapped)
            if torso is not None:
                torsos[t].append(torso)
        head = head.displaced(outline_offset(model, views, landmarks))
        if chart is not None:
            model, own = own_expressions(model, head.parameters, chart, skin, [t for _, t in places])
            edges = np.flatnonzero(np.isin(numbers, EDGES))
            seen = np.where(np.isfinite(head.errors)[..., None], track.landmarks, np.nan)[:, :, edges]
            lids = np.isin(numbers[edges], LIDS)
            model, own = edge_expressions(model, own, head.cameras, landmarks[edges], lids, seen)
            head = replace(head, model=model, parameters=own)
        model, own = lids_before_eyeballs(model, head.parameters, head.cameras)
        if not track.one_moment:
            model, own = bend_with_torso(model, own, torsos)
        head = replace(head, model=model, parameters=own)
        frames = tuple(
            Frame(t, c, "", split, f"{t:05d}_{c:02d}.png", f"{t:05d}_{c:02d}_matte.png", parameter_file(t), c)
            for t, row in enumerate(names)
            for c, split in enumerate(row)
        )
        capture = Capture(frames_folder, Path("head_model.npz"), frames, cameras, background)
        write_dataset(folder, capture, model, dict(enumerate(head.parameters)), place=_moved)
        return replace(track, head=head)
    finally:
        shutil.rmtree(frames_folder, ignore_errors=True)


def _moved(source: Path, part: Path, folder: Path, name: str) -> str:
    """Move a file into a dataset; arguments as of `carigs.capture.dataset_writer.copied`."""
    shutil.move(source, part / name)
    return name


def tracked_cameras(track: FootageTrack, recordings: Sequence[Recording]) -> tuple[Camera, ...]:
    """The cameras of tracked footage.

    Args:
        track: The tracked head.
        recordings: The frames.

    Returns:
        One for each recording that is tracked.
    """
    footages = [recordings[r].footage for r in track.cameras]
    return track.head.cameras.pinholes([(footage.width, footage.height) for footage in footages])


def tracked_splits(
    track: FootageTrack, cameras: Sequence[Camera], by_time: Callable[[int], list[str]]
) -> list[list[str]]:
    """Divide tracked footage into splits.

    Args:
        track: The tracked head.
        cameras: Its cameras.
        by_time: Names the split of each tracked timestep of a clip.

    Returns:
        `train`, `val` or `test` for each timestep and camera.
    """
    return held_out(len(track.kept), len(track.cameras), _frontal(cameras), by_time)


def _frontal(cameras: Sequence[Camera]) -> int:
    """The camera that is nearest to the z axis, to which the face looks."""
    return int(np.argmax([camera.centre[2] / np.linalg.norm(camera.centre) for camera in cameras]))
