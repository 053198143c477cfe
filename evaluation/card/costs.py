"""Costs of a study: size of the avatars, time of a frame, and time and memory of each stage."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.readers.npz import read_npz
from carigs.runs.job_record import Costs
from evaluation.card.card import CardValue
from evaluation.card.measures import AVATAR_MEASURES, STAGE_MEASURES
from evaluation.tables.bootstrap import mean_interval

BINDING = "surfel_binding"
NO_RECORD = "no record of the costs of {} of {} jobs"


def frame_step(level: float) -> str:
    """Name of the step of the stage `render` whose mean time is that of a frame.

    Args:
        level: Exaggeration level of the frame.

    Returns:
        The name in the job's record.
    """
    return f"frame level={level:g}"


class RecordedJob(NamedTuple):
    """A job of a study, by the name of its log."""

    stage: str
    point: str
    """Subject, gamma, variant and seed, as in the name of the log."""


class RenderingJob(NamedTuple):
    """The rendering of an avatar at a level."""

    job: RecordedJob
    seed: int
    """Of the avatar's training."""
    level: float


def avatar_values(
    subject: str,
    variant: str,
    avatars: Mapping[int, Path],
    renderings: Sequence[RenderingJob],
    costs: Costs,
) -> list[CardValue]:
    """Size of the avatars of a variant and the time in which they were rendered: means over all seeds.

    Args:
        subject: Name of the subject.
        variant: Name of the variant.
        avatars: Their files by seed.
        renderings: The jobs that rendered them.
        costs: Costs of jobs.

    Returns:
        One value per measure of `AVATAR_MEASURES`.

    Raises:
        InputError: An avatar cannot be read.
    """

    def value(measure: str, amounts: Sequence[float], *factors: Sequence[float]) -> CardValue:
        mean, low, high = mean_interval(np.array(amounts, float), factors)
        ends = (None, None) if np.isnan(low) else (max(low, 0.0), high)
        return CardValue(measure, subject, variant, None, "avatar", "", "", mean, *ends, len(amounts), 0, "")

    bindings = [read_npz(file, "avatar", [BINDING], only=[BINDING])[BINDING] for file in avatars.values()]
    surfels = [len(binding) for binding in bindings]
    values = [
        value("surfels", surfels, [*avatars]),
        value("avatar_bytes", [os.path.getsize(file) for file in avatars.values()], [*avatars]),
    ]
    timed = [r for r in renderings if r.job in costs and costs[r.job].steps.get(frame_step(r.level))]
    if not timed:
        jobs = len({rendering.job for rendering in renderings})
        reason = NO_RECORD.format(jobs, jobs)
        return values + missing_avatar_values(subject, variant, reason, ("frame_seconds", "frames_per_second"))
    seconds = [costs[rendering.job].steps[frame_step(rendering.level)] for rendering in timed]
    seeds, levels = [rendering.seed for rendering in timed], [rendering.level for rendering in timed]
    time = value("frame_seconds", seconds, seeds, levels)
    ends = {"low": time.high and 1 / time.high, "high": 1 / time.low if time.low else None}
    return [*values, time, time._replace(measure="frames_per_second", value=1 / time.value, **ends)]


def missing_avatar_values(
    subject: str, variant: str, reason: str, measures: Iterable[str] = tuple(AVATAR_MEASURES)
) -> list[CardValue]:
    """Values of an avatar that are not known.

    Args:
        subject: Name of the subject.
        variant: Name of the variant.
        reason: Why.
        measures: Names of the measures.

    Returns:
        One value per measure.
    """
    return [
        CardValue(name, subject, variant, None, "avatar", "", "", None, None, None, 0, 1, reason) for name in measures
    ]


def stage_values(stages: Mapping[str, Sequence[RecordedJob]], costs: Costs) -> list[CardValue]:
    """Time and memory of stages.

    Args:
        stages: The jobs of each stage.
        costs: Costs of jobs.

    Returns:
        One value per stage and measure of `STAGE_MEASURES`.
    """
    values = []
    for stage, jobs in stages.items():
        known = [costs[job] for job in jobs if job in costs]
        missing = len(jobs) - len(known)
        reason = NO_RECORD.format(missing, len(jobs)) if missing else ""
        memory = [cost.peak_memory_mb for cost in known if cost.peak_memory_mb is not None]
        amounts = (
            sum(cost.seconds for cost in known) if known else None,
            sum(cost.cpu_seconds for cost in known) if known else None,
            max(memory, default=None),
        )
        for measure, amount in zip(STAGE_MEASURES, amounts, strict=True):
            why = reason or ("" if amount is not None else "this operating system does not count it")
            values.append(
                CardValue(measure, "", "", None, "stage", stage, "", amount, None, None, len(known), missing, why)
            )
    return values
