"""State of a training run on disk: a run that was killed continues from it, to the same bytes."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from torch import Tensor

from carigs.editing.dataset_update import DatasetUpdate
from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.readers.json_files import parse_json
from carigs.readers.npz import read_npz
from carigs.splat.surfels.surfels import Surfels, checked_surfels, to_arrays
from carigs.splat.training.adam import Adam
from carigs.splat.training.density import GradientStatistics
from carigs.splat.training.tracking_refinement import TrackingRefinement
from carigs.system.files import writing


class Checkpoint(NamedTuple):
    """Where the state of a run is kept."""

    file: Path
    """An .npz file; it need not exist."""
    key: str
    """Digest of everything that the run depends on. A state with another key is ignored."""


@dataclass
class TrainingState:
    """Everything that the next step depends on, and the log.

    Attributes:
        iteration: Number of steps done.
        iterations: Number of steps of the settings, or that fit into their budget.
        surfels: The surfels.
        adam: Their optimiser.
        statistics: Gradients since the last density control.
        log: Rows of the log.
        losses: Losses since the last row; tensors on a device if the step computes there.
        seconds: Training time, earlier runs included.
        refinement: Refinement of the tracked head parameters, if enabled.
        edits: Frames that edits have replaced, if there are edits.
    """

    iteration: int
    iterations: int
    surfels: Surfels
    adam: Adam
    statistics: GradientStatistics
    log: list[tuple] = field(default_factory=list)
    losses: list[float | Tensor] = field(default_factory=list)
    seconds: float = 0.0
    refinement: TrackingRefinement | None = None
    edits: DatasetUpdate | None = None


def save_checkpoint(checkpoint: Checkpoint, state: TrainingState) -> None:
    """Write the state under a temporary name, then rename it.

    Args:
        checkpoint: Where the state is kept.
        state: State of the run.
    """
    with writing(checkpoint.file) as part, part.open("wb") as stream:
        np.savez(
            stream,
            key=checkpoint.key,
            iteration=state.iteration,
            iterations=state.iterations,
            steps=state.adam.steps,
            seconds=state.seconds,
            rows=json.dumps(state.log),
            losses=np.array([float(loss) for loss in state.losses]),
            total=state.statistics.total,
            views=state.statistics.views,
            **to_arrays(state.surfels),
            **state.adam.as_arrays(),
            **(state.refinement.as_arrays() if state.refinement else {}),
            **(state.edits.as_arrays() if state.edits else {}),
        )


def load_checkpoint(
    checkpoint: Checkpoint,
    num_faces: int,
    refinement: TrackingRefinement | None = None,
    edits: DatasetUpdate | None = None,
) -> TrainingState | None:
    """Read the state of a run with the same inputs.

    Args:
        checkpoint: Where `save_checkpoint` has written it.
        num_faces: Number of the head's triangles.
        refinement: Refinement of the tracking, set to its saved state.
        edits: Edits of the frames, set to their saved state.

    Returns:
        The state; None if there is no file, if it is broken, or if it is of a run with another key.
    """
    file = checkpoint.file
    try:
        arrays = read_npz(file)
        if str(arrays["key"]) != checkpoint.key:
            return None
        surfels = checked_surfels(arrays, num_faces, file)
        adam, statistics = Adam(surfels), GradientStatistics(len(surfels))
        adam.restore(int(arrays["steps"]), arrays)
        for name in ("total", "views"):
            expected = getattr(statistics, name)
            setattr(statistics, name, checked_array(arrays, name, expected.shape, expected.dtype, file=file))
        log = [tuple(row) for row in parse_json(str(arrays["rows"]), file, "rows")]
        losses = checked_array(arrays, "losses", (None,), np.float64, file=file).tolist()
        seconds = float(arrays["seconds"])
        if refinement is not None:
            refinement.restore(arrays)
        if edits is not None:
            edits.restore(arrays)
        done, steps = int(arrays["iteration"]), int(arrays["iterations"])
        return TrainingState(done, steps, surfels, adam, statistics, log, losses, seconds, refinement, edits)
    except (InputError, ValueError, KeyError, TypeError):
        return None
