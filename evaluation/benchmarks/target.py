"""Time and error of GT* targets over the options of the warp and of relighting.

Time: CPU ms of one thread for a frame of 802x550. Error: test frames of the procedural subject, warped without
relighting, against renderings of its caricature under the same light. n x n is the supersampling of outline pixels.

Example:
    python -m evaluation.benchmarks.target results/benchmark/target.csv
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import chain, product
from pathlib import Path

import cv2
import numpy as np

from carigs.capture import Capture
from carigs.exaggeration import GammaPath
from carigs.gtstar import face_mask_flags, flags_from_names
from carigs.raster import compute_visibility
from carigs.settings import DEFAULT_MASK_FLAGS, Gtstar, Toy
from evaluation.benchmarks.measurement.plots import plot_target
from evaluation.benchmarks.measurement.timing import Measurement, cpu_seconds, median_time, write_measurements
from evaluation.benchmarks.measurement.toy_frames import SIZE, caricature_scenes, enlarged, warp_scene, write_subject
from evaluation.benchmarks.relighting import measure_light_directions, measure_relighting
from evaluation.command_line import csv_parser, run
from evaluation.figures.misregistration import ERROR_THRESHOLD

FRAMES = 6
REPEATS = 9
OPTIONS = tuple(product(("affine", "perspective"), (1, 2, 4, 8)))
"""Values of `gtstar.warp` and `gtstar.supersampling`."""


def measure_warp(subject: Capture, path: GammaPath, repeats: int = REPEATS) -> Iterator[Measurement]:
    """Measure time and error of targets at gamma_f for each of `OPTIONS`.

    Args:
        subject: Capture of the procedural subject.
        path: Its caricature path.
        repeats: Number of timed calls.

    Yields:
        Records; the reference is the paper's warp: affine, one sample.
    """
    model, exaggerated = subject.model, path.at(path.gamma_f)
    face_flags = face_mask_flags(model, Gtstar())
    excluded = np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    frames = subject.split("test")[:: max(1, len(subject.split("test")) // FRAMES)][:FRAMES]
    scenes = caricature_scenes(subject, frames, exaggerated)
    image, matte, *meshes, camera, _, _ = scenes[0]
    large = (cv2.resize(image, SIZE), cv2.resize(matte, SIZE), *meshes, enlarged(camera))
    scene = f"{len(model.faces)} triangles, {SIZE[1]}x{SIZE[0]}"
    seconds = median_time(lambda: compute_visibility(meshes[0], model.faces, large[-1]), repeats, cpu_seconds)
    yield Measurement(scene, "visibility at one end", "ms", 1e3 * seconds)
    references: dict[str, float] = {}
    for option in sorted(OPTIONS, key=lambda option: option != ("affine", 1)):
        warp, samples = option
        settings = Gtstar(warp=warp, supersampling=samples)
        make_one = partial(warp_scene, subject, face_flags, settings)
        seconds, pixels = median_time(lambda make=make_one: make(*large), repeats, cpu_seconds), []
        for *scene, truth, true_matte in scenes:
            target = make_one(*scene)
            error = np.abs(target.colour - truth).mean(axis=2)
            pixels.append((error, target.caricature.face >= 0, (target.mask_flags & excluded) > 0, true_matte > 0))
        error, on_mesh, left_out, head = map(np.stack, zip(*pixels, strict=True))
        trusted, wrong = error[on_mesh & ~left_out], (on_mesh | head) & (error > ERROR_THRESHOLD)
        values = {
            "visibility, warp and masks": 1e3 * seconds,
            "mean absolute error": trusted.mean(),
            "99th percentile of the error": np.quantile(trusted, 0.99),
            "share of the mesh's pixels that is left out": left_out[on_mesh].mean(),
            f"share of the head's errors above {ERROR_THRESHOLD} that is left out": left_out[wrong].mean(),
        }
        case = f"{warp}, {samples}x{samples}"
        for unit, (quantity, value) in zip(("ms", "1", "1", "1", "1"), values.items(), strict=True):
            yield Measurement(case, quantity, unit, float(value), references.setdefault(quantity, float(value)))


def benchmark(file: Path, folder: Path | None = None, toy: Toy | None = None, repeats: int = REPEATS) -> None:
    """Measure, and write the records and their plot.

    Args:
        file: CSV file to write; the plot goes beside it.
        folder: Folder with `capture.json` and `path.npz` of a procedural subject; None to make one.
        toy: Settings of the subject to make.
        repeats: Number of timed calls.
    """
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            folder = Path(temporary)
            write_subject(folder, toy or Toy(steps_per_sequence=1))
        subject, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
        light = chain(measure_relighting(subject, path), measure_light_directions(subject, path))
        measurements = chain(measure_warp(subject, path, repeats), light)
        plot_target(file.with_suffix(".png"), write_measurements(file, measurements))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="with capture.json and path.npz of a procedural subject")
    arguments = parser.parse_args()
    benchmark(arguments.rows, arguments.folder)


if __name__ == "__main__":
    run(main)
