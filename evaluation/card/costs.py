"""Costs of a study: size of the avatars, time of a frame, and time and memory of each stage."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.job_record import Costs
from carigs.readers.json_files import read_json
from carigs.readers.npz import read_npz
from carigs.settings import Tabulate
from evaluation.card.card import Value
from evaluation.card.measures import AVATAR_MEASURES, STAGE_MEASURES
from evaluation.tables.bootstrap import mean_interval

NO_RECORD = "no record of the costs of {} of {} jobs"


class Job(NamedTuple):
    """A job of a study, by the name of its log."""

    stage: str
    point: str
    """Subject, gamma, variant and level, as in the name of the log."""


def avatar_values(
    subject: str, variant: str, avatar: Path, renderings: Mapping[Job, int], costs: Costs, settings: Tabulate
) -> list[Value]:
    """Size of an avatar and the time in which it was rendered.

    Args:
        subject: Name of the subject.
        variant: Name of the variant.
        avatar: Its file.
        renderings: Number of frames of each job that rendered it.
        costs: Costs of jobs.
        settings: Settings of the intervals.

    Returns:
        One value per measure of `AVATAR_MEASURES`.

    Raises:
        InputError: The avatar cannot be read.
    """
    surfels = len(read_npz(avatar, "avatar", ["surfel_binding"])["surfel_binding"])
    values = [_avatar_value("surfels", subject, variant, surfels)]
    values.append(_avatar_value("avatar_bytes", subject, variant, os.path.getsize(avatar)))
    timed = np.array([costs[job].seconds / frames for job, frames in renderings.items() if job in costs and frames])
    if not timed.size:
        reason = NO_RECORD.format(len(renderings), len(renderings))
        return values + missing_avatar_values(subject, variant, reason, ("frame_seconds", "frames_per_second"))
    drawn = {"resamples": settings.resamples, "confidence": settings.confidence, "seed": settings.seed}
    mean, low, high = mean_interval(timed, [np.arange(len(timed))], **drawn)
    ends = (None, None) if np.isnan(low) else (max(low, 0.0), high)
    rates = (1 / high, 1 / low if low > 0 else None) if ends[1] else (None, None)
    values.append(_avatar_value("frame_seconds", subject, variant, mean, *ends, n=len(timed)))
    values.append(_avatar_value("frames_per_second", subject, variant, 1 / mean, *rates, n=len(timed)))
    return values


def missing_avatar_values(
    subject: str, variant: str, reason: str, measures: Iterable[str] = tuple(AVATAR_MEASURES)
) -> list[Value]:
    """Values of an avatar that are not known.

    Args:
        subject: Name of the subject.
        variant: Name of the variant.
        reason: Why.
        measures: Names of the measures.

    Returns:
        One value per measure.
    """
    return [Value(name, subject, variant, None, "avatar", "", "", None, None, None, 0, 1, reason) for name in measures]


def stage_values(stages: Mapping[str, Sequence[Job]], costs: Costs) -> list[Value]:
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
                Value(measure, "", "", None, "stage", stage, "", amount, None, None, len(known), missing, why)
            )
    return values


def count_frames(index: Path) -> int:
    """Count the frames of an index.

    Args:
        index: Index of rendered frames, which need not be there.

    Returns:
        Their number.

    Raises:
        InputError: The index is missing or broken.
    """
    return len(read_json(index, list))


def _avatar_value(
    measure: str,
    subject: str,
    variant: str,
    value: float,
    low: float | None = None,
    high: float | None = None,
    n: int = 1,
) -> Value:
    return Value(measure, subject, variant, None, "avatar", "", "", value, low, high, n, 0, "")
