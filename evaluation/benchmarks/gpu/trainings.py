"""Trainings on a device and on the processor of the same machine: PSNR of held-out frames against seconds."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import torch
from omegaconf import OmegaConf

from carigs.capture import Capture
from carigs.config import compose
from carigs.head import neutral
from carigs.settings import Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.surfels.surfels import from_arrays, to_arrays
from carigs.splat.training.subject import TrainingSubject, prepare_subject
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.gpu.figures import Figure, Task
from evaluation.benchmarks.measurement.toy_frames import write_index_and_path, write_subject
from evaluation.benchmarks.measurement.toy_training import HeldOutView, held_out_view, inputs_of, psnr_by_region
from evaluation.metrics.regions import surface_regions

if TYPE_CHECKING:
    from carigs.splat.training.checkpoint import TrainingState

SUBJECTS = {
    "toy, 272x208": ("study=toy", "subject=toy"),
    "toy, 802x550": (
        "study=toy",
        "subject=toy",
        "capture.toy.height=802",
        "capture.toy.width=550",
        "capture.toy.cameras=4",
        "capture.toy.steps_per_sequence=1",
    ),
    "ict_s1, 401x275": ("study=ict", "subject=ict_s1"),
}
"""Overrides of the subjects; `ict_s1` needs the folder CARIGS_DATA."""
MARKS = 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1
"""Shares of the steps after which PSNR is measured."""
WARM_UP = 20
"""Steps of a training before the one that is timed, which loads or compiles kernels."""
VIEWS = 12
"""Held-out frames that are compared."""
MOST_STEPS = {("cpu", True): 1000, ("cpu", False): 100, ("torch", False): 2}
"""Most steps of a backend, with a CUDA device and without one; `cuda` does all steps of the study."""


@dataclass(frozen=True)
class Subject:
    """What a training reads, and what it is judged by."""

    train: Train
    prepared: TrainingSubject
    capture: Capture
    views: list[HeldOutView]


def measure(task: Task) -> Iterator[Figure]:
    """Train every subject on the device and on the processor.

    Args:
        task: The device.

    Yields:
        Seconds and PSNR at level 0 after some of the steps, steps per second, and the largest memory in use.
    """
    cuda = task.cuda
    use_threads(cores())
    for name, overrides in SUBJECTS.items():
        if not _has_data(overrides):
            continue
        with TemporaryDirectory() as folder:
            start = time.perf_counter()
            subject = prepare(Path(folder), overrides)
            yield Figure(name, "capture, path, hair and targets", time.perf_counter() - start, "s")
            for backend in ("cuda" if cuda else "torch", "cpu"):
                steps = min(subject.train.iterations, MOST_STEPS.get((backend, cuda), subject.train.iterations))
                yield from train(f"{name}, {backend}", subject, backend, steps)


def _has_data(overrides: Sequence[str]) -> bool:
    return "subject=toy" in overrides or bool(os.environ.get("CARIGS_DATA"))


def cores() -> int:
    """Cores that this process may use.

    Returns:
        Their number, at most 16: more threads do not help the kernels.
    """
    return min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, 16)


def prepare(folder: Path, overrides: Sequence[str]) -> Subject:
    """Make what a training reads.

    Args:
        folder: Empty folder.
        overrides: Study, subject, and settings.

    Returns:
        The subject.
    """
    config = compose("variant=alternating", *overrides)
    sections = (config.capture, config.exaggerate, config.gtstar, config.train)
    source, exaggerate, gtstar, settings = map(OmegaConf.to_object, sections)
    if source.source == "toy":
        write_subject(folder, source.toy, exaggerate)
    else:  # the caricature is computed here, too
        write_index_and_path(folder, Path(source.folder), Path(source.head_model), replace(exaggerate, file=None))
    person, path, hair, targets = inputs_of(folder, gtstar, cores())
    prepared = prepare_subject(person, path, settings, hair, [targets])
    held_out = person.split("test")
    surface = surface_regions(person.model, neutral(person.model, person.parameters(person.frames[0].timestep)))
    views = [
        held_out_view(person, frame, path.at(0.0), surface, person.image(frame), person.foreground(frame))
        for frame in held_out[:: -(-len(held_out) // VIEWS)]
    ]
    return Subject(settings, prepared, person, views)


class EnoughError(Exception):
    """The steps that were asked for are done."""


class Curve:
    """Observer of a training that measures images after some of its steps; the clock stands still meanwhile.

    Args:
        subject: What is trained.
        settings: Settings of the training.
        steps: Step after which the training is ended.
    """

    def __init__(self, subject: Subject, settings: Train, steps: int) -> None:
        self.subject, self.settings, self.steps = subject, settings, steps
        self.marks = {max(round(share * settings.iterations), 1) for share in MARKS} | {steps}
        self.points: list[tuple[int, float, Mapping[str, float]]] = []
        self.start = time.perf_counter()

    def __call__(self, state: TrainingState) -> None:
        """Measure the images, if that is due after this step.

        Args:
            state: State of the training after the step.

        Raises:
            EnoughError: It was the last step.
        """
        if state.iteration not in self.marks:
            return
        if self.settings.backend == "cuda":
            torch.cuda.synchronize()
        now, subject, settings = time.perf_counter(), self.subject, self.settings
        surfels, background = from_arrays(**to_arrays(state.surfels)), subject.capture.background
        avatar = Avatar(surfels, subject.prepared.sequence, settings.rig, settings.rotate_harmonics, background)
        self.points.append((state.iteration, now - self.start, psnr_by_region(avatar, 0.0, subject.views)))
        self.start += time.perf_counter() - now
        if state.iteration == self.steps:
            raise EnoughError


def train(case: str, subject: Subject, backend: str, steps: int) -> Iterator[Figure]:
    """Train once, and measure the images of some of the steps.

    Args:
        case: Name of the figures.
        subject: What is trained.
        backend: Backend of the training.
        steps: Number of steps of its schedule that are done.

    Yields:
        The figures.
    """
    settings = replace(subject.train, backend=backend)
    if backend != "torch":
        warm_up = replace(settings, iterations=WARM_UP, density=replace(settings.density, every=0))
        train_surfels(warm_up, subject.prepared)
    if backend == "cuda":
        torch.cuda.reset_peak_memory_stats()
    curve = Curve(subject, settings, steps)
    with suppress(EnoughError):
        train_surfels(settings, subject.prepared, on_step=curve)
    for step, seconds, psnr in curve.points:
        yield Figure(case, f"seconds of {step} steps", seconds, "s")
        for region in ("full", "face", "hair"):
            if region in psnr:
                yield Figure(case, f"PSNR of {region} after {step} steps", psnr[region], "dB")
    if len(curve.points) > 1:
        (first, before, _), (last, after, _) = curve.points[-2:]
        yield Figure(case, "steps per second", (last - first) / (after - before), "1/s")
    if backend == "cuda":
        yield Figure(case, "memory", torch.cuda.max_memory_allocated() / 2**20, "MiB")
