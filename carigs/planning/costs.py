"""Seconds and bytes of a job: from an earlier run of the study, else from a table of costs per pixel and step.

The table was measured on two cores of a cloud machine with the toy study and `study=ict`, with compiled kernels. It
holds for the backend `cpu`, and without embedding networks.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

import numpy as np
from omegaconf import DictConfig

from carigs.config import compose
from carigs.editing.edit_steps import number_of_edits
from carigs.errors import InputError
from carigs.planning.footage import Footage
from carigs.planning.job_graph import Job
from carigs.readers.json_files import read_json
from carigs.settings.train import budget_seconds

JOB_START = 0.3
"""Seconds from the decision to start a job to its first step: fork or interpreter, imports, settings."""
REFERENCE_SPEED = 0.0285
"""Seconds of `speed_test` on the machine of the table."""

NETWORK_PASSES = {"instruct_pix2pix": 3.0, "controlnet_ip2p": 3.0}
"""Passes of Stable Diffusion's network for a step of an edit: for text and image, image, and neither. With a ControlNet
two, each with half a network more."""
CODING_PASSES = 5.0
"""What the autoencoder takes for an edit, in such passes: two images are encoded, one is decoded."""
PAINTING_STEPS = 30
"""Steps of the whole schedule for a GT* frame of the provider `exemplar`, of two passes each."""
PASS_SECONDS = 9.3
"""Of one pass at 512 x 512 pixels in float32, on one core."""


def job_seconds(job: Job, footage: Mapping[str, Footage], overrides: Sequence[str]) -> float:
    """Seconds of a job by the table, on one thread for each that it asks for.

    Args:
        job: The job.
        footage: Images of each subject.
        overrides: Hydra overrides of the study.

    Returns:
        Wall-clock seconds.
    """
    if job.is_local:
        return 0.03
    images = footage.get(job.wildcards.get("subject", ""))
    settings = _settings(job, overrides)
    match job.rule:
        case "capture":
            samples = images.megapixels * (images.train + images.val + images.test)
            if settings.capture.source == "toy":
                work = 3.0 + 0.083 * samples * settings.capture.toy.supersampling**2
            else:
                work = 2.0 + 0.15 * samples
        case "track":
            frames = images.train + images.val + images.test
            work = 10.0 + frames * (0.25 + 0.7 * images.megapixels)
        case "exaggerate":
            work = 2.1 if settings.exaggerate.file or settings.capture.source == "toy" else 5.0
        case "hair":
            work = 4.0 + 6.0 / job.threads  # 144 frames at most, at a resolution that is limited
        case "gtstar":
            work = 1.5 + 1.1 * images.megapixels * images.train / job.threads
            if settings.gtstar.provider == "exemplar":
                passes = 2 * PAINTING_STEPS * settings.gtstar.exemplar_strength + CODING_PASSES
                work += images.train * passes * PASS_SECONDS / job.threads**0.8
        case "target_sheet":
            work = 2.0
        case "train":
            # A step costs a part for the surfels and a part for the pixels; harmonics make the surfels dearer.
            step = (0.0126 + 0.26 * images.megapixels) * (1 + 0.15 * settings.train.sh_degree)
            training = budget_seconds(settings.train.budget) or settings.train.iterations * step
            work = 3.0 + (training + _edit_seconds(settings.train)) / job.threads**0.8
        case "render":
            count = _rendered(images, settings, orbit=settings.render.orbit_frames)
            work = 0.5 + 0.77 * images.megapixels * count / job.threads**0.8
        case "html":
            work = 8.0
        case "truth":
            work = 0.3
            if settings.capture.source == "toy" and job.wildcards["level"] != "0":
                work += 1.2 * images.megapixels * images.test
        case "metrics":
            work = 0.3 + 0.76 * images.megapixels * _rendered(images, settings, orbit=0)
        case "tabulate":
            work = 1.0 + 0.28 * len(job.needs)
        case "figures":
            work = 5.0 + 0.17 * len(job.needs)
        case "card":
            work = 1.0
        case "sweep":
            work = 1.5 + 0.02 * len(job.needs)
        case "report":
            work = 1.5 + 0.02 * len(job.needs)
        case _:
            work = 10.0
    return JOB_START + work


def job_bytes(job: Job, footage: Mapping[str, Footage], overrides: Sequence[str]) -> float:
    """Bytes that a job writes.

    Args:
        job: The job.
        footage: Images of each subject.
        overrides: Hydra overrides of the study.

    Returns:
        Bytes of its outputs.
    """
    images = footage.get(job.wildcards.get("subject", ""), Footage(0, 0, 0, 0, 0.0, ""))
    settings = _settings(job, overrides)
    is_toy = settings.capture.source == "toy"
    match job.rule:
        case "capture":
            count = 1.4 * (images.train + images.val + images.test) if is_toy else 0
        case "track":
            count = images.train + images.val + images.test
        case "gtstar":
            count = images.train
        case "truth":
            count = 0.6 * images.test if is_toy or settings.truth.folder else 0
        case "render":
            count = _rendered(images, settings, orbit=settings.render.orbit_frames)
        case _:
            count = 0
    others = {"train": 30e6, "exaggerate": 7e6, "figures": 3e6, "target_sheet": 1e6, "html": 4e6, "report": 2e6}
    return 1e6 * count * images.megapixels + others.get(job.rule, 1e4)


def earlier_times(jobs: Sequence[Job], folder: Path) -> dict[int, float]:
    """Seconds that jobs took in an earlier run in the current directory.

    Args:
        jobs: The jobs.
        folder: Snakemake's folder of records, `.snakemake/metadata`.

    Returns:
        Seconds by number of the job, for those that ran here before. A job of a cluster includes its wait in the queue.
    """
    by_log = {job.log: job.number for job in jobs if job.log and not job.is_local}
    found = {}
    for file in folder.glob("*") if folder.is_dir() else ():
        try:
            record = read_json(file, dict)
            logs, start, end = record.get("log"), float(record["starttime"]), float(record["endtime"])
        except (InputError, KeyError, TypeError, ValueError):  # a record of another kind, or one that is being written
            continue
        for log in logs if isinstance(logs, list) else [logs]:
            if log in by_log and not record.get("incomplete") and end >= start:
                found[by_log[log]] = end - start
    return found


def all_seconds(
    jobs: Sequence[Job], table: Mapping[int, float], earlier: Mapping[int, float], speed: float
) -> dict[int, float]:
    """Seconds of every job.

    Args:
        jobs: The jobs.
        table: Seconds of each by the table (`job_seconds`), by number.
        earlier: Seconds of jobs that ran before.
        speed: Seconds that this machine takes for what takes the table's machine one second.

    Returns:
        Seconds by number of the job. A job that did not run before gets the table's time, corrected by the median ratio
        of measured times to the table's for its rule; or by `speed` if no job of the rule ran.
    """
    ratios: dict[str, list[float]] = {}
    for job in jobs:
        if job.number in earlier:
            ratios.setdefault(job.rule, []).append(earlier[job.number] / table[job.number])
    factors = {rule: median(values) for rule, values in ratios.items()}
    return {
        job.number: earlier.get(job.number, table[job.number] * factors.get(job.rule, speed)) for job in jobs
    }  # fmt: skip


def speed_test() -> float:
    """Time a fixed computation: the CPU seconds of the fastest of nine repetitions.

    It has arithmetic on arrays, reads in random order, and interpreted code, as the jobs have. It has no sort and no
    product of matrices: libraries choose other code for those on processors of another maker.

    Returns:
        Seconds.
    """
    values = np.linspace(-3.0, 0.0, 1_000_000)
    order = np.random.default_rng(0).permutation(len(values))
    times = []
    for _ in range(9):
        started = time.process_time()
        (np.exp(values) * np.cos(values))[order].sum()
        sum(i * i for i in range(200_000))
        times.append(time.process_time() - started)
    return min(times)


def _rendered(images: Footage, settings: DictConfig, orbit: int) -> int:
    """Images of all levels, with `orbit` frames of the orbit at each."""
    timesteps = settings.render.test_timesteps
    return sum(images.rendered(level, timesteps) + orbit for level in settings.render.levels)


def _edit_seconds(train: DictConfig) -> float:
    """Seconds of all edits of a training on one core."""
    edits = number_of_edits(train.edit, train.iterations, train.start is not None)
    if train.edit.editor not in NETWORK_PASSES:
        return 0.05 * edits
    return 60.0 + edits * PASS_SECONDS * (train.edit.steps * NETWORK_PASSES[train.edit.editor] + CODING_PASSES)


def _settings(job: Job, overrides: Sequence[str]) -> DictConfig:
    """The composed settings of a job."""
    # Of the wildcards, those that settings of the stage depend on: the levels to render depend on gamma.
    names = ("subject", "gamma") if job.rule in ("render", "metrics") else ("subject", "variant")
    return compose(*overrides, *(f"{name}={job.wildcards[name]}" for name in names if name in job.wildcards))
