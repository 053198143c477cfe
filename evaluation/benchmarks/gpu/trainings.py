"""Trainings on a device and on the processor of the same machine: PSNR of held-out frames against seconds."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from omegaconf import OmegaConf

from carigs.capture import Capture
from carigs.capture.target_index import read_targets
from carigs.config import compose
from carigs.hair import load_hair
from carigs.head import neutral, read_subject_path
from carigs.settings import Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.surfels.surfels import from_arrays, to_arrays
from carigs.splat.training.subject import TrainingSubject, prepare_subject
from carigs.splat.training.trainer import train_surfels
from carigs.stages.capture import capture
from carigs.stages.exaggerate import exaggerate
from carigs.stages.gtstar import gtstar
from carigs.stages.hair import hair
from evaluation.benchmarks.gpu.figures import Figure, Task
from evaluation.benchmarks.measurement.toy_training import HeldOutView, held_out_view, psnr_by_region
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
    subjects = {name: overrides for name, overrides in SUBJECTS.items() if _has_data(overrides)}
    folders = {name: task.folder / "subjects" / name.replace(", ", "_") for name in subjects}
    start = time.perf_counter()
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        list(pool.map(prepare, folders.values(), subjects.values()))
    yield Figure("subjects", "captures, paths, hair and targets", time.perf_counter() - start, "s")
    for name, overrides in subjects.items():
        subject = load(folders[name], overrides)
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


def _settings(overrides: Sequence[str]) -> dict[str, Any]:
    config = compose("variant=alternating", *overrides)
    return {name: OmegaConf.to_object(config[name]) for name in ("capture", "exaggerate", "hair", "gtstar", "train")}


def _files(folder: Path) -> dict[str, Path]:
    return {"capture": folder / "capture.json", "path": folder / "path.npz", "hair": folder / "hair.npz"}


def prepare(folder: Path, overrides: Sequence[str]) -> None:
    """Run the stages before the training, unless they have run already.

    Args:
        folder: Folder of the subject.
        overrides: Study, subject, and settings.
    """
    if (folder / "targets.json").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    settings, files, threads = _settings(overrides), _files(folder), cores()
    capture(settings["capture"], index=files["capture"], dataset=folder / "dataset")
    exaggerate(settings["exaggerate"], capture=files["capture"], path=files["path"])
    hair(settings["hair"], capture=files["capture"], found=files["hair"], threads=threads)
    gtstar(
        settings["gtstar"], **files, level=settings["exaggerate"].gamma, targets=folder / "targets",
        index=folder / "targets.json", resume_key="", threads=threads,
    )  # fmt: skip


def load(folder: Path, overrides: Sequence[str]) -> Subject:
    """Read what `prepare` has written.

    Args:
        folder: Folder of the subject.
        overrides: Study, subject, and settings.

    Returns:
        The subject.
    """
    train, files = _settings(overrides)["train"], _files(folder)
    person = Capture.load(files["capture"])
    path = read_subject_path(files["path"], person.model)
    found = load_hair(files["hair"], len(person.model.faces))
    prepared = prepare_subject(person, path, train, found, [read_targets(folder / "targets.json", person)])
    held_out = person.split("test")
    surface = surface_regions(person.model, neutral(person.model, person.parameters(person.frames[0].timestep)))
    views = [
        held_out_view(person, frame, path.at(0.0), surface, person.image(frame), person.foreground(frame))
        for frame in held_out[:: -(-len(held_out) // VIEWS)]
    ]
    return Subject(train, prepared, person, views)


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
