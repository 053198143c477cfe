"""State of a training run on disk: a run that was killed continues from it, to the same bytes."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from torch import Tensor

from carigs.errors import InputError
from carigs.files import writing
from carigs.mesh.carried_points import CarriedPoints
from carigs.readers.arrays import checked_array
from carigs.readers.json_files import parse_json
from carigs.readers.npz import read_npz
from carigs.settings import Train
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels, checked_surfels, to_arrays
from carigs.splat.training.adam import Adam
from carigs.splat.training.density import GradientStatistics
from carigs.splat.training.hair_surfels import HairSurfels
from carigs.splat.training.plateau import Ending, validation_frames
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.tracking_refinement import TrackingRefinement


@dataclass
class TrainingState:
    """Everything that the next step depends on, and the log.

    Attributes:
        iteration: Number of steps done.
        iterations: Number of steps of the settings, or that fit into their budget.
        ending: Where the training ends.
        surfels: The surfels.
        adam: Their optimiser.
        statistics: Gradients since the last density control.
        validation: Numbers of steps, and the PSNR (dB) of the held-out frames after them.
        log: Rows of the log.
        losses: Losses since the last row; tensors on a device if the step computes there.
        seconds: Training time, earlier runs included.
        refinement: Refinement of the tracked head parameters, if enabled.
    """

    iteration: int
    iterations: int
    ending: Ending
    surfels: Surfels
    adam: Adam
    statistics: GradientStatistics
    validation: list[tuple[int, float]] = field(default_factory=list)
    log: list[tuple] = field(default_factory=list)
    losses: list[float | Tensor] = field(default_factory=list)
    seconds: float = 0.0
    refinement: TrackingRefinement | None = None


def run_digest(
    settings: Train,
    sequence: HeadSequence,
    supervision: Supervision,
    hair: HairSurfels | None = None,
    mouth: CarriedPoints | None = None,
) -> str:
    """Digest of the inputs of a run; a checkpoint of other settings, meshes or images is ignored.

    Args:
        settings: Settings of the stage.
        sequence: The subject.
        supervision: Training frames and targets.
        hair: Where hair is.
        mouth: Points inside the mouth.

    Returns:
        SHA-256 in hexadecimal digits.
    """
    digest = hashlib.sha256()
    # The number of threads and the interval of checkpoints do not change the result.
    relevant = {k: v for k, v in asdict(settings).items() if k not in ("threads", "checkpoint_seconds")}
    digest.update(json.dumps(relevant, sort_keys=True).encode())
    digest.update(sequence.rig.vertices.tobytes() + sequence.rig.faces.tobytes() + sequence.rig.keeps_size.tobytes())
    for array in (sequence.path.displacements, sequence.path.columns, sequence.path.changes):
        digest.update(b"" if array is None else array.tobytes())
    if sequence.shading is not None:
        digest.update(b"".join(np.asarray(value).tobytes() for value in asdict(sequence.shading).values()))
    if sequence.hair_shadow is not None:
        shadow = sequence.hair_shadow.as_arrays().values()
        digest.update(b"".join(np.ascontiguousarray(value).tobytes() for value in shadow))
    if hair is not None:
        arrays = (*hair.points, hair.covered, hair.hidden)
        digest.update(b"".join(np.ascontiguousarray(value).tobytes() for value in arrays))
    if mouth is not None:
        digest.update(b"".join(np.ascontiguousarray(value).tobytes() for value in mouth))
    digest.update(json.dumps([(target.level, target.weight) for target in supervision.targets]).encode())
    for file in (
        *supervision.files(),
        *_validation_files(settings, supervision),
        *([Path(settings.start)] if settings.start else ()),
    ):
        status = file.stat()
        digest.update(f"{file.name} {status.st_size} {status.st_mtime_ns}".encode())
    return digest.hexdigest()


def _validation_files(settings: Train, supervision: Supervision) -> list[Path]:
    """Images that decide where the training ends."""
    if not settings.plateau.every:
        return []
    capture = supervision.capture
    return [capture.root / frame.image for frame in validation_frames(capture, settings.plateau.frames)]


def save_checkpoint(file: Path, state: TrainingState, digest: str) -> None:
    """Write the state under a temporary name, then rename it.

    Args:
        file: File to write (.npz).
        state: State of the run.
        digest: Result of `run_digest`.
    """
    with writing(file) as part, part.open("wb") as stream:
        np.savez(
            stream,
            key=digest,
            iteration=state.iteration,
            iterations=state.iterations,
            ending=json.dumps(state.ending),
            validation=json.dumps(state.validation),
            steps=state.adam.steps,
            seconds=state.seconds,
            rows=json.dumps(state.log),
            losses=np.array([float(loss) for loss in state.losses]),
            total=state.statistics.total,
            views=state.statistics.views,
            **to_arrays(state.surfels),
            **state.adam.as_arrays(),
            **(state.refinement.as_arrays() if state.refinement else {}),
        )


def load_checkpoint(
    file: Path, digest: str, num_faces: int, refinement: TrackingRefinement | None = None
) -> TrainingState | None:
    """Read the state of a run with the same inputs.

    Args:
        file: File that `save_checkpoint` wrote.
        digest: Result of `run_digest`.
        num_faces: Number of the head's triangles.
        refinement: Refinement of the tracking, set to its saved state.

    Returns:
        The state; None if there is no file, if it is broken, or if it is of a run with other inputs.
    """
    try:
        arrays = read_npz(file)
        if str(arrays["key"]) != digest:
            return None
        surfels = checked_surfels(arrays, num_faces, file)
        adam, statistics = Adam(surfels), GradientStatistics(len(surfels))
        adam.restore(int(arrays["steps"]), arrays)
        for name in ("total", "views"):
            expected = getattr(statistics, name)
            setattr(statistics, name, checked_array(arrays, name, expected.shape, expected.dtype, file=file))
        log = [tuple(row) for row in parse_json(str(arrays["rows"]), file, "rows")]
        validation = [
            (int(step), float(psnr)) for step, psnr in parse_json(str(arrays["validation"]), file, "validation")
        ]
        ending = Ending(*parse_json(str(arrays["ending"]), file, "ending"))
        losses = checked_array(arrays, "losses", (None,), np.float64, file=file).tolist()
        seconds = float(arrays["seconds"])
        if refinement is not None:
            refinement.restore(arrays)
        done, steps = int(arrays["iteration"]), int(arrays["iterations"])
        return TrainingState(
            done, steps, ending, surfels, adam, statistics, validation, log, losses, seconds, refinement
        )
    except (InputError, ValueError, KeyError, TypeError):
        return None
