"""The dataset of a tracked video: frames with mattes, the camera, head parameters and the person's head model."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from carigs.capture import Camera, Capture, Frame
from carigs.capture.dataset_writer import parameter_file, write_dataset
from carigs.capture.images import write_png
from carigs.footage import Footage
from carigs.head import neutral, pose
from carigs.matting import MattedFrame, composite
from carigs.tracking.footage_tracking import FootageTrack
from carigs.tracking.held_out import blocks
from carigs.tracking.neck_cut import NeckCut


def write_tracked_dataset(
    folder: Path,
    track: FootageTrack,
    footage: Footage,
    matted: Iterable[MattedFrame],
    *,
    background: float,
    chin: float | None = None,
    splits: Callable[[int], list[str]] = blocks,
) -> None:
    """Write a tracked video as a dataset that studies read.

    Args:
        folder: Folder to create.
        track: The tracked head.
        footage: The frames.
        matted: All of them with mattes, in order; those that are not tracked are passed over.
        background: Grey value that frames are composited on.
        chin: Height of the chin on the neutral head in metres: mattes end below it. None to keep the body.
        splits: Names the split of each tracked frame.

    Raises:
        InputError: If the folder holds something.
    """
    camera = tracked_camera(track, footage)
    frames_folder = folder.parent / f".{folder.name}.frames"
    shutil.rmtree(frames_folder, ignore_errors=True)
    frames_folder.mkdir(parents=True)
    head, model = track.head, track.head.model
    cut = NeckCut(neutral(model, head.parameters[0]), model.faces, chin) if chin is not None else None
    position = {int(footage.numbers[k]): t for t, k in enumerate(track.kept)}
    try:
        for frame, alpha, foreground in matted:
            if frame.number not in position:
                continue
            t = position[frame.number]
            if cut is not None:
                alpha = alpha * cut.kept_share(pose(model, head.parameters[t]), camera)
            write_png(frames_folder / f"{t:05d}_00.png", composite(foreground, alpha, background) / 255.0)
            write_png(frames_folder / f"{t:05d}_00_matte.png", alpha)
        names = splits(len(track.kept))
        frames = tuple(
            Frame(t, 0, "", split, f"{t:05d}_00.png", f"{t:05d}_00_matte.png", parameter_file(t), 0)
            for t, split in enumerate(names)
        )
        capture = Capture(frames_folder, Path("head_model.npz"), frames, (camera,), background)
        write_dataset(folder, capture, model, dict(enumerate(head.parameters)), place=_moved)
    finally:
        shutil.rmtree(frames_folder, ignore_errors=True)


def _moved(source: Path, part: Path, folder: Path, name: str) -> str:
    """Move a file into a dataset; arguments as of `carigs.capture.dataset_writer.copied`."""
    shutil.move(source, part / name)
    return name


def tracked_camera(track: FootageTrack, footage: Footage) -> Camera:
    """The camera of a tracked video.

    Args:
        track: The tracked head.
        footage: The frames.

    Returns:
        The camera.
    """
    cameras = track.head.cameras
    camera_from_world = np.eye(4)
    camera_from_world[:3] = cameras.camera_from_world()[0]
    focal, (cx, cy) = float(cameras.focal[0]), cameras.centres[0]
    return Camera(camera_from_world, focal, focal, float(cx), float(cy), footage.width, footage.height)
