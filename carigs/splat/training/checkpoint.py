"""A run's state on disk, so that a killed run goes on where it was, to the same bytes."""

from __future__ import annotations

import hashlib
import json
import zipfile
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from carigs.files import writing
from carigs.settings import Train
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import ATTRIBUTES, Surfels, from_arrays, to_arrays
from carigs.splat.training.adam import Adam, as_arrays, restore
from carigs.splat.training.density import GradientStatistics
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.tracking_refinement import TrackingRefinement


@dataclass
class State:
    """Everything that the next step depends on, and the log so far."""

    iteration: int
    """Steps done."""
    surfels: Surfels
    adam: Adam
    statistics: GradientStatistics
    rows: list[tuple] = field(default_factory=list)
    """Of the log."""
    losses: list[float] = field(default_factory=list)
    """Since the last row."""
    seconds: float = 0.0
    """Spent in earlier sittings."""
    tuning: TrackingRefinement | None = None
    """Of the tracked head, where that is fine-tuned."""


def fingerprint(settings: Train, performance: HeadSequence, supervision: Supervision) -> str:
    """Digest of the inputs: a checkpoint of other settings, meshes or images is not gone on with."""
    digest = hashlib.sha256()
    # How fast, how often saved: no part of the result.
    shown = {k: v for k, v in asdict(settings).items() if k not in ("threads", "checkpoint_seconds")}
    digest.update(json.dumps(shown, sort_keys=True).encode())
    digest.update(performance.rig.vertices.tobytes() + performance.rig.faces.tobytes())
    for array in (performance.path.displacements, performance.path.columns, performance.path.changes):
        digest.update(b"" if array is None else array.tobytes())
    if performance.shading is not None:
        digest.update(b"".join(np.asarray(value).tobytes() for value in asdict(performance.shading).values()))
    digest.update(json.dumps([(target.level, target.weight) for target in supervision.targets]).encode())
    for file in supervision.files():
        status = file.stat()
        digest.update(f"{file.name} {status.st_size} {status.st_mtime_ns}".encode())
    return digest.hexdigest()


def save_state(file: Path, state: State, key: str) -> None:
    """Write the state under a temporary name, then rename it."""
    with writing(file) as part, part.open("wb") as stream:
        np.savez(
            stream,
            key=key,
            iteration=state.iteration,
            steps=state.adam.steps,
            seconds=state.seconds,
            rows=json.dumps(state.rows),
            losses=np.array(state.losses),
            total=state.statistics.total,
            views=state.statistics.views,
            **to_arrays(state.surfels),
            **as_arrays(state.adam),
            **(state.tuning.as_arrays() if state.tuning else {}),
        )


def load_state(file: Path, key: str, tuning: TrackingRefinement | None = None) -> State | None:
    """The state saved by a run with the same inputs; None if there is none that can be gone on with.

    `tuning` is set to where it was.
    """
    try:
        with np.load(file) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if str(arrays["key"]) != key:
            return None
        surfels = from_arrays(**{name: arrays[name] for name in (*ATTRIBUTES, "binding")})
        adam = Adam(surfels)
        restore(adam, int(arrays["steps"]), arrays)
        statistics = GradientStatistics(len(surfels))
        statistics.total, statistics.views = arrays["total"], arrays["views"]
        rows = [tuple(row) for row in json.loads(str(arrays["rows"]))]
        losses, seconds = arrays["losses"].tolist(), float(arrays["seconds"])
        if tuning is not None:
            tuning.restore(arrays)
        return State(int(arrays["iteration"]), surfels, adam, statistics, rows, losses, seconds, tuning)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
