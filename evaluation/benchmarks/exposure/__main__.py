"""Cameras of different exposure and white balance: how closely training frames are matched, and a copy to train on.

Training frames are made brighter or darker, each camera by factors of its own; test frames and the validation camera
stay as they are.

Example:
    python -m evaluation.benchmarks.exposure exposures.csv data/ict_s1 ict_model.npz
    python -m evaluation.benchmarks.exposure factors.csv data/ict_s1 ict_model.npz --copy data/disturbed --seed 1
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture, Frame, read_dataset
from carigs.exposure import match_exposures, measure_exposures
from evaluation.benchmarks.exposure.disturbed_dataset import EXPOSURE, constant_factor, disturb_dataset, drawn_factors
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

SEEDS = 3
EVERY = 7
"""Every n-th training frame is compared."""


class Case(NamedTuple):
    """A way in which exposures differ."""

    name: str
    factor_of: Callable[[Frame], Float[np.ndarray, "3"] | None]
    """Factors of a frame; None for a frame that stays as it is."""
    stored: bool = False


def cases(capture: Capture) -> Iterator[Case]:
    """What is measured.

    Args:
        capture: The dataset.

    Yields:
        The dataset as it is, cameras that differ, and one camera whose exposure changes over time.
    """
    yield Case("as it is", lambda _: None)
    for seed in range(SEEDS):
        for stored in (False, True):
            factors = drawn_factors(capture, seed)
            kind = "stored values" if stored else "light"
            yield Case(f"factors of {kind}, seed {seed}", partial(constant_factor, factors), stored)
    one = next(c for c in capture.cameras if c != capture.validation_camera)
    yield Case(f"light of camera {one} over time", partial(changing_factor, one, len(capture.parameter_files)))


def changing_factor(camera: int, count: int, frame: Frame) -> Float[np.ndarray, "3"] | None:
    """Factors of one camera whose automatic exposure goes up and down once.

    Args:
        camera: The camera.
        count: Number of timesteps.
        frame: A frame.

    Returns:
        Factors; None for other frames.
    """
    if frame.split != "train" or frame.camera != camera:
        return None
    return np.full(3, 1 + EXPOSURE * np.sin(2 * np.pi * frame.timestep / count))


def measure(source: Path, head_model: Path) -> Iterator[Measurement]:
    """Disturb a dataset in several ways, and match its exposures.

    Args:
        source: The dataset.
        head_model: Its head model.

    Yields:
        Of each case: CPU time, number of cameras whose frames are changed, and the root mean square difference of the
        foreground of training frames from the frames as they were.
    """
    capture = read_dataset(source, head_model)
    measure_exposures(capture)  # the first time loads the kernels
    for case in cases(capture):
        with TemporaryDirectory() as temporary:
            disturb_dataset(capture, Path(temporary) / "copy", case.factor_of, stored=case.stored)
            found, start = replace(capture, root=Path(temporary) / "copy"), time.process_time()
            matched = match_exposures(found, measure_exposures(found))
            yield Measurement(case.name, "CPU time", "s", time.process_time() - start)
            changed = {frame.camera for frame in matched.frames if frame.gains is not None}
            yield Measurement(case.name, "cameras changed", "", len(changed))
            before, after = (_difference(each, capture) for each in (found, matched))
            yield Measurement(case.name, "difference of training frames", "levels", after, before)


def _difference(first: Capture, second: Capture) -> float:
    """Root mean square difference of the foregrounds of training frames, in levels of 255."""
    squares, count = 0.0, 0
    for a, b in list(zip(first.split("train"), second.split("train"), strict=True))[::EVERY]:
        inside = second.foreground(b) >= 1
        difference = first.image8(a)[inside].astype(np.float64) - second.image8(b)[inside]
        squares, count = squares + float(np.square(difference).sum()), count + difference.size
    return float(np.sqrt(squares / max(count, 1)))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("dataset", type=Path, help="a dataset whose cameras have one exposure")
    parser.add_argument("head_model", type=Path, help="its head model")
    parser.add_argument("--copy", type=Path, metavar="FOLDER", help="write a disturbed copy, and measure nothing")
    parser.add_argument("--seed", type=int, default=0, help="of the copy (default %(default)s)")
    parser.add_argument("--stored", action="store_true", help="the factors of the copy hold for stored values")
    task = parser.parse_args()
    if task.copy is None:
        write_measurements(task.rows, measure(task.dataset, task.head_model))
        return
    capture = read_dataset(task.dataset, task.head_model)
    factors = drawn_factors(capture, task.seed)
    disturb_dataset(capture, task.copy, partial(constant_factor, factors), stored=task.stored)
    rows = [
        Measurement(f"camera {c}", name, "", float(f))
        for c in factors
        for name, f in zip("rgb", factors[c], strict=True)
    ]
    write_measurements(task.rows, rows)


if __name__ == "__main__":
    run(main)
