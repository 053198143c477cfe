"""Hair that few cameras show: does it have the outline that the other cameras see?

Example:
    python -m evaluation.benchmarks.few_cameras outlines.csv data/ict_s1 ict_model.npz --cameras 2,9,12 --cameras 0,14
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool

from carigs.capture import Capture, read_dataset
from carigs.capture.evenly_spread import evenly_spread
from carigs.hair import find_hair
from carigs.hair.hull import Voxels
from carigs.hair.views import HairView, read_views, scalp_motion
from carigs.head import neutral
from carigs.settings import Hair
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

FRAMES = 12
"""Frames of other cameras that outlines are compared in."""


def measure(source: Path, head_model: Path, choices: Sequence[Sequence[int]]) -> Iterator[Measurement]:
    """Find hair in the frames of a few cameras, and compare its outline in the frames of the others.

    Args:
        source: A dataset with mattes of the head.
        head_model: Its head model.
        choices: Numbers of cameras; without any, all cameras are taken, and compared with.

    Yields:
        Of each choice: the volume, and the outline of mesh and hair above the lips beside the matte.
    """
    whole = read_dataset(source, head_model)
    for chosen in choices:
        frames = [frame for frame in whole.frames if frame.split != "test"]
        train = [frame for frame in frames if frame.camera in chosen or not chosen]
        other = [frame for frame in frames if frame.camera not in chosen or not chosen]
        few = replace(whole, frames=tuple(replace(frame, split="train") for frame in train))
        volume = find_hair(Hair(), few).volume
        name = f"cameras {' '.join(map(str, chosen)) or 'all'}"
        yield Measurement(name, "volume", "litres", 1000 * len(volume.centres) * volume.size**3)
        covered = missing = total = 0
        for frame in evenly_spread(other, FRAMES):
            (view,) = read_views(replace(whole, frames=(replace(frame, split="train"),)))
            outline, matte = _outline(volume, view, few), view.foreground > 0.5
            above = np.arange(len(matte))[:, None] < _lower_lip(view, few)
            covered += (outline & ~matte & above).sum()
            missing += (matte & ~outline & above).sum()
            total += (matte & above).sum()
        yield Measurement(name, "background that is covered", "% of the matte", 100 * covered / total)
        yield Measurement(name, "matte that is left out", "% of the matte", 100 * missing / total)


def _outline(volume: Voxels, view: HairView, capture: Capture) -> Bool[np.ndarray, "h w"]:
    """Pixels of the mesh, and of voxels that move with the scalp."""
    model = capture.model
    carrier = np.unique(model.faces[model.face_region(*Hair().regions.hair)])
    canonical = neutral(model, capture.parameters(capture.frames[0].timestep))
    camera, motion = view.visibility.camera, scalp_motion(canonical, view.visibility, carrier)
    points = volume.centres @ motion[:, :3].T + motion[:, 3]
    pixels = camera.intrinsics[:2] * points[:, :2] / points[:, 2:] + camera.intrinsics[2:]
    inside = (points[:, 2] > 0) & (pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
    column, row = pixels[inside].astype(int).T
    filled = np.zeros(view.foreground.shape, np.uint8)
    filled[row, column] = 1
    radius = int(np.ceil(volume.size * camera.fx / np.median(points[:, 2]) / 2)) if len(points) else 0
    return (cv2.dilate(filled, np.ones((2 * radius + 1,) * 2, np.uint8)) > 0) | (view.visibility.face >= 0)


def _lower_lip(view: HairView, capture: Capture) -> float:
    """Row of the lowest vertex of the lips: mattes below may show a body."""
    model, camera = capture.model, view.visibility.camera
    points = view.visibility.camera_points[np.unique(model.faces[model.face_region("lips")])]
    return float((camera.fy * points[:, 1] / points[:, 2] + camera.cy).max())


def _numbers(text: str) -> list[int]:
    return [int(number) for number in text.split(",") if number]


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("dataset", type=Path, help="a dataset with mattes of the head")
    parser.add_argument("head_model", type=Path, help="its head model")
    parser.add_argument(
        "--cameras", type=_numbers, action="append", default=[], help="such as 2,9,12; several times; default: all"
    )
    task = parser.parse_args()
    write_measurements(task.rows, measure(task.dataset, task.head_model, task.cameras or [[]]))


if __name__ == "__main__":
    run(main)
