"""Damages of the transforms files: cameras, indexes and paths."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from stress.capture_changes.edits import edit_frames, edit_transforms, update_frames
from stress.capture_changes.folder import Change, Folder

OPENCV_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def damages() -> Iterator[tuple[str, Change]]:
    """Damages of the entries of frames.

    Yields:
        Name and change.
    """
    # Cameras
    yield "fl_y is negative", partial(update_frames, fl_y=lambda f: -f)
    yield (
        "the last row of the matrices is 0 0 0 5",
        partial(_move_cameras, change=lambda m: np.vstack([m[:3], [0, 0, 0, 5]])),
    )
    yield "fl_x times 1.2", partial(update_frames, fl_x=lambda f: 1.2 * f)
    yield "fl_x and fl_y times 0.8", partial(update_frames, fl_x=lambda f: 0.8 * f, fl_y=lambda f: 0.8 * f)
    yield (
        "fl_x of camera 5 times 1.15",
        partial(update_frames, where="_05", fl_x=lambda f: 1.15 * f, fl_y=lambda f: 1.15 * f),
    )
    yield "fl_x as a share of the width", partial(update_frames, fl_x=lambda f: f / 275, fl_y=lambda f: f / 275)
    yield (
        "intrinsics of half the resolution",
        partial(update_frames, fl_x=lambda f: f / 2, fl_y=lambda f: f / 2, cx=lambda c: c / 2, cy=lambda c: c / 2),
    )
    yield "cx = cy = 0.5", partial(update_frames, cx=0.5, cy=0.5)
    yield "cx outside the image", partial(update_frames, cx=900.0)
    yield "cx + 12 pixels", partial(update_frames, cx=lambda c: c + 12)
    yield "cy - 14 pixels", partial(update_frames, cy=lambda c: c - 14)
    yield "cx of camera 5 + 24 pixels", partial(update_frames, where="_05", cx=lambda c: c + 24)
    yield "w and h exchanged", partial(update_frames, w=401, h=275)
    yield "matrices mirror", partial(_move_cameras, change=lambda m: m @ np.diag([-1.0, 1, 1, 1]))
    yield "matrices have OpenCV's axes", partial(_move_cameras, change=lambda m: m @ OPENCV_AXES)
    yield "matrices are world-to-camera", partial(_move_cameras, change=np.linalg.inv)
    yield (
        "rotations are transposed",
        partial(_move_cameras, change=lambda m: np.block([[m[:3, :3].T, m[:3, 3:]], [m[3:]]])),
    )
    yield (
        "matrices are in millimetres",
        partial(_move_cameras, change=lambda m: np.vstack([np.column_stack([m[:3, :3], 1000 * m[:3, 3]]), m[3:]])),
    )
    yield "camera 5 is turned by 180 degrees", partial(_move_cameras, change=lambda m: m @ HALF_TURN, where="_05")
    yield (
        "camera 5 is 4 cm off",
        partial(_move_cameras, change=lambda m: m + 0.04 * np.pad(np.ones((1, 1)), ((0, 3), (3, 0))), where="_05"),
    )
    yield "the poses of cameras 5 and 6 are exchanged", partial(_exchange_poses, a=5, b=6)
    yield "camera 3 is listed twice", _list_twice
    # Indexes and paths
    yield "an image is listed for two frames", partial(update_frames, where="00004_03", file_path="images/00004_04.png")
    yield "a timestep is 1.5", partial(update_frames, where="00001_03", timestep_index=1.5)
    yield "absolute paths", lambda f: update_frames(f, file_path=lambda name: str(f.root / name))
    yield "a path leaves the folder", partial(update_frames, where="00004_03", file_path="../../secret.png")


def _move_cameras(folder: Folder, change: Callable[[np.ndarray], np.ndarray], where: str = ".*") -> None:
    """Change the camera-to-world matrices."""
    update_frames(folder, where, transform_matrix=lambda rows: change(np.array(rows)).tolist())


def _exchange_poses(folder: Folder, a: int, b: int) -> None:
    poses: dict[int, Any] = {}
    edit_frames(folder, lambda entry: poses.setdefault(entry["camera_index"], entry["transform_matrix"]))
    other = {a: b, b: a}
    edit_frames(
        folder,
        lambda entry: entry.update(transform_matrix=poses[other.get(entry["camera_index"], entry["camera_index"])]),
    )


def _list_twice(folder: Folder) -> None:
    def change(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        copies = []
        for entry in entries:
            if entry["camera_index"] == 3:
                name = entry["file_path"].replace("_03.", "_99.")
                if not (folder.root / name).exists():
                    shutil.copyfile(folder.root / entry["file_path"], folder.root / name)
                copies.append({**entry, "camera_index": 99, "file_path": name})
        return entries + copies

    edit_transforms(folder, change)
