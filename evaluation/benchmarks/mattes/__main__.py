"""Wrong mattes and old backgrounds at outlines: are they named, how closely are they mended, and a copy to train on.

Example:
    python -m evaluation.benchmarks.mattes outlines.csv data/ict_s1 ict_model.npz
    python -m evaluation.benchmarks.mattes copy.csv data/ict_s1 ict_model.npz --copy data/damaged --kind grown
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from carigs.capture import Capture, read_dataset
from carigs.plausibility.outlines import measure_outlines, mend_outlines
from evaluation.benchmarks.mattes.damaged_dataset import IMAGES, MATTES, damage_dataset
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

EVERY = 7
"""Every n-th training frame is compared."""
MIXED = 0.01, 0.99
"""Opacities of the pixels whose colours are compared."""


def measure(source: Path, head_model: Path) -> Iterator[Measurement]:
    """Damage a dataset in several ways, and mend its outlines.

    Args:
        source: A dataset with sound mattes, composited on its background.
        head_model: Its head model.

    Yields:
        Of each case: CPU time, number of cameras that are named, and the errors of training frames, with those of the
        damaged frames as reference: of opacities over the length of the outline, and of colours of mixed pixels.
    """
    sound = read_dataset(source, head_model)
    measure_outlines(sound)  # the first time reads the files
    for kind in ("as it is", *MATTES, *IMAGES):
        with TemporaryDirectory() as temporary:
            damaged = sound
            if kind != "as it is":
                damage_dataset(sound, Path(temporary) / "copy", kind)
                damaged = replace(sound, root=Path(temporary) / "copy")
            start = time.process_time()
            found = measure_outlines(damaged)
            yield Measurement(kind, "CPU time", "s", time.process_time() - start)
            yield Measurement(kind, "cameras named", "", len(found))
            mended = mend_outlines(damaged, found)
            before, after = (_errors(each, sound) for each in (damaged, mended))
            yield Measurement(kind, "error of opacities", "pixels", after[0], before[0])
            yield Measurement(kind, "error of colours", "levels", after[1], before[1])


def _errors(capture: Capture, sound: Capture) -> tuple[float, float]:
    """Mean absolute error of opacities across outlines, and root mean square error of the colours of mixed pixels."""
    area, length, squares, count = 0.0, 0.0, 0.0, 0
    for a, b in list(zip(capture.split("train"), sound.split("train"), strict=True))[::EVERY]:
        alpha = sound.foreground(b)
        area += float(np.abs(capture.foreground(a) - alpha).sum())
        length += float(np.hypot(*np.gradient(alpha)).sum())
        mixed = (alpha > MIXED[0]) & (alpha < MIXED[1])
        difference = capture.image8(a)[mixed].astype(np.float64) - sound.image8(b)[mixed]
        squares, count = squares + float(np.square(difference).sum()), count + difference.size
    return area / max(length, 1.0), float(np.sqrt(squares / max(count, 1)))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("dataset", type=Path, help="a dataset with sound mattes, composited on white")
    parser.add_argument("head_model", type=Path, help="its head model")
    parser.add_argument("--copy", type=Path, metavar="FOLDER", help="write a damaged copy, and measure nothing")
    parser.add_argument("--kind", choices=(*MATTES, *IMAGES), default="grown", help="of the copy (default %(default)s)")
    task = parser.parse_args()
    if task.copy is None:
        write_measurements(task.rows, measure(task.dataset, task.head_model))
        return
    capture = read_dataset(task.dataset, task.head_model)
    damage_dataset(capture, task.copy, task.kind)
    write_measurements(task.rows, [Measurement(task.kind, "frames", "", len(capture.frames))])


if __name__ == "__main__":
    run(main)
