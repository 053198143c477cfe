"""Time and error of trainings on the toy: one setting at a time around its default, and the presets.

A case is a line of overrides of the study `toy`. Each trains the variant `alternating` once, on one thread. Series
change one setting of the preset `balanced`, the study itself; those of the number of steps end density control after
two thirds of them, as the study does. Cases with equal settings are trained once.

Time: CPU seconds of the training, including reading images and the first colours. Error: PSNR by region, mean over the
test frames, against captured frames at level 0 and the true caricature at gamma. Rendered images have the study's size,
whatever the size of the training images.

Example:
    python -m evaluation.benchmarks.training_trade_offs results/benchmark/training.csv
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from omegaconf import OmegaConf

from carigs.config import compose, known
from carigs.settings import Exaggerate, Gtstar, Toy, Train
from carigs.simd.threads import use_threads
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.benchmarks.measurement.toy_training import (
    HeldOutView,
    TrainingInputs,
    held_out_views,
    make_inputs,
    psnr_by_region,
    train_avatar,
)
from evaluation.command_line import csv_parser, run

STUDY = ("study=toy", "subject=toy", "variant=alternating")
SERIES = (
    *(f"train.iterations={steps} train.density.stop={2 * steps // 3}" for steps in (375, 750, 1500, 6000)),
    *(f"train.sh_degree={degree}" for degree in (1, 2, 3)),
    *(f"train.surfels_per_face={count}" for count in (2, 4)),
    *(f"train.density.gradient_threshold={threshold:g}" for threshold in (0.00005, 0.0001, 0.0004, 0.0008)),
    *(f"capture.toy.width={13 * k} capture.toy.height={17 * k}" for k in (8, 12, 24)),
)
"""Overrides of each case. The defaults are left out: they are the preset `balanced`."""
WARM_UP_STEPS = 8
"""Steps of a training before the measured one, in which kernels are loaded or compiled."""


class CaseSettings(NamedTuple):
    """The sections that decide what a training gives."""

    toy: Toy
    exaggerate: Exaggerate
    gtstar: Gtstar
    train: Train


class Result(NamedTuple):
    """What one training costs and gives."""

    seconds: float
    """CPU time."""
    surfels: int
    natural: dict[str, float]
    """PSNR in dB by region at level 0."""
    caricature: dict[str, float]
    """The same at gamma."""


def list_cases() -> list[str]:
    """List what is trained.

    Returns:
        The presets, and `SERIES`.
    """
    return [*(f"preset={name}" for name in known("preset")), *SERIES]


def case_settings(case: str, *overrides: str) -> CaseSettings:
    """Compose the settings of a case.

    Args:
        case: Overrides, separated by blanks.
        *overrides: Overrides of all cases.

    Returns:
        The settings.
    """
    config = compose(*STUDY, *overrides, *case.split())
    sections = (config.capture.toy, config.exaggerate, config.gtstar, config.train)
    toy, exaggerate, gtstar, train = map(OmegaConf.to_object, sections)
    return CaseSettings(toy, exaggerate, gtstar, train)


class TrainingBench:
    """Trains and evaluates settings, and remembers the results.

    Args:
        folder: Folder for captures and targets.
        shown: Settings of the subject whose test frames are compared.
    """

    def __init__(self, folder: Path, shown: CaseSettings) -> None:
        self.folder = folder
        self._inputs: dict[str, TrainingInputs] = {}
        self._results: dict[str, Result] = {}
        subject = self.inputs(shown)
        self.gamma = subject.path.gamma_f
        self.views: dict[float, list[HeldOutView]] = {
            level: held_out_views(subject, level) for level in (0.0, self.gamma)
        }

    def inputs(self, settings: CaseSettings) -> TrainingInputs:
        """Capture, path and targets of some settings.

        Args:
            settings: The settings.

        Returns:
            What a training reads; made once.
        """
        key = repr(settings[:3])
        if key not in self._inputs:
            folder = self.folder / f"{len(self._inputs)}"
            folder.mkdir()
            self._inputs[key] = make_inputs(folder, *settings[:3])
        return self._inputs[key]

    def result(self, settings: CaseSettings) -> Result:
        """Train and evaluate.

        Args:
            settings: The settings.

        Returns:
            Cost and quality; of the first training with these settings.
        """
        key = repr(settings)
        if key not in self._results:
            inputs = self.inputs(settings)
            density = replace(settings.train.density, start=1, every=WARM_UP_STEPS // 2)
            train_avatar(inputs, replace(settings.train, iterations=WARM_UP_STEPS, density=density))
            started = time.process_time()
            avatar = train_avatar(inputs, settings.train)
            seconds = time.process_time() - started
            quality = (psnr_by_region(avatar, level, views) for level, views in self.views.items())
            self._results[key] = Result(seconds, len(avatar.surfels), *quality)
        return self._results[key]


def measure(cases: Sequence[str], folder: Path, *overrides: str) -> Iterator[Measurement]:
    """Train and evaluate all cases.

    Args:
        cases: Overrides of each, separated by blanks.
        folder: Empty folder for captures and targets.
        *overrides: Overrides of all cases.

    Yields:
        CPU time, number of surfels, and PSNR by region at both levels.
    """
    use_threads(1)
    settings = {case: case_settings(case, *overrides) for case in cases}
    bench = TrainingBench(folder, case_settings("", *overrides))
    for case, chosen in settings.items():
        result = bench.result(chosen)
        yield Measurement(case, "training", "CPU s", result.seconds)
        yield Measurement(case, "surfels", "1", result.surfels)
        for level, values in (("0", result.natural), ("gamma", result.caricature)):
            for region, value in values.items():
                yield Measurement(case, f"PSNR at level {level}, {region}", "dB", value)


def main() -> None:
    """Run the benchmark from the command line; all settings are checked before work starts."""
    parser = csv_parser(__doc__)
    parser.add_argument("--cases", nargs="+", default=list_cases(), metavar="OVERRIDES", help="what to train")
    parser.add_argument(
        "--overrides", nargs="*", default=[], metavar="OVERRIDE", help="of all cases; those of a case win"
    )
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        write_measurements(arguments.rows, measure(arguments.cases, Path(folder), *arguments.overrides))


if __name__ == "__main__":
    run(main)
