"""How far a head tracked in footage is from the true one, in mm: one camera, a camera that circles, three cameras.

`carigs.tracking.footage_tracking` gets frames and landmarks, and nothing else of the truth: landmarks without errors,
and with those of a network (`oracle_landmarks`); the focal length guessed, or stated. One similarity for the whole
clip, found by the face, takes the tracked head to the true one: cameras without calibration determine no more. Before
one camera, the depth of each frame is hardly determined either; errors after a similarity of each frame leave it out.
Gaps between lids and lips are compared by the slope of the line that fits tracked against true gaps.

Example:
    python -m evaluation.benchmarks.footage.tracked_heads toy.csv
    python -m evaluation.benchmarks.footage.tracked_heads ict.csv --dataset ict_s1 --head-model ict_model.npz
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits

from carigs.capture import read_dataset
from carigs.detection.mesh_indices import LEFT_LID_GAPS, LIP_GAPS, RIGHT_LID_GAPS
from carigs.embedding import landmark_embedding
from carigs.exaggeration.rigid_components import umeyama
from carigs.head import HeadModel, neutral
from carigs.head.facial_regions import lid_faces
from carigs.head.posing import pose_frames
from carigs.settings import Track
from carigs.tracking.footage_tracking import FootageTrack, choose_frames, track_footage
from carigs.tracking.recording import Recording
from carigs.tracking.video import MOST_VIEWS
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, LandmarkNoise
from evaluation.benchmarks.footage.oracle_recordings import (
    SEED,
    Filmed,
    filmed_dataset,
    filmed_toy,
    oracle_recordings,
    toy_subject,
)
from evaluation.benchmarks.footage.scenes import KINDS
from evaluation.benchmarks.footage.truth import FootageTruth
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

ERRORS: dict[str, LandmarkNoise | None] = {"exact landmarks": EXACT, "landmarks of a network": None}
FOCAL_LENGTHS = ("guessed", "stated")
GAPS = {"lids": (*LEFT_LID_GAPS, *RIGHT_LID_GAPS), "lips": LIP_GAPS}


def tracked(
    recordings: Sequence[Recording], model: HeadModel, kind: str, focal_length: float | None = None
) -> FootageTrack:
    """Track footage as `carigs track` does once networks have looked at it.

    Args:
        recordings: Of each camera.
        model: The head model.
        kind: One of `evaluation.benchmarks.footage.scenes.KINDS`.
        focal_length: What is stated, in pixels; None if it is guessed.

    Returns:
        The head.
    """
    embedding = landmark_embedding(model)
    seen = recordings[0].views(MOST_VIEWS) if kind == "orbit" else recordings
    points, given = embedding.points(model), [focal_length] * len(seen)
    with threadpool_limits(1, "blas"):
        return track_footage(seen, choose_frames(seen), model, points, embedding.landmarks, focal_lengths=given)


def face_vertices(model: HeadModel, rest: Float[np.ndarray, "v 3"]) -> dict[str, Int[np.ndarray, " n"]]:
    """Vertices of the parts of the face that errors are given for.

    Args:
        model: The head model.
        rest: The person's neutral head.

    Returns:
        Indices by part.
    """
    return {
        "face": np.flatnonzero(model.vertex_region("face")),
        "lids": np.unique(model.faces[lid_faces(model, rest)]),
        "lips": np.flatnonzero(model.vertex_region("lips")),
    }


def mean_opening(
    truth: FootageTruth,
    heads: Float[np.ndarray, "t v 3"],
    true: Float[np.ndarray, "t v 3"],
    kept: Int[np.ndarray, " t"],
    pairs: Sequence[tuple[int, int]],
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """How far pairs of landmarks are apart in the direction in which the true ones are in the mean, on the head.

    Their whole distance also has what landmarks are off along the lids and in depth: where these are closed, it is not
    0, and grows less as they open.

    Args:
        truth: Head and cameras.
        heads: Tracked vertices, nearest to the true ones.
        true: The true ones.
        kept: Their timesteps.
        pairs: Numbers of MediaPipe's upper and lower landmarks.

    Returns:
        Mean of the pairs in each frame, tracked and true, in the unit of the vertices.
    """
    embedding = landmark_embedding(truth.model)
    points, turns = embedding.points(truth.model), truth.world_from_head()[kept]
    sides = [points[numbers] for numbers in np.searchsorted(embedding.landmarks, np.array(pairs)).T]
    gaps = []
    for vertices in (heads, true):
        upper, lower = (np.stack([side.interpolate(head) for head in vertices]) for side in sides)
        gaps.append(np.einsum("tpj,tji->tpi", upper - lower, turns))
    direction = gaps[1].mean(axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found, wanted = (np.einsum("tpi,pi->tp", gap, direction).mean(axis=1) for gap in gaps)
    return found, wanted


def compared(truth: FootageTruth, track: FootageTrack, case: str) -> Iterator[Measurement]:
    """Compare a tracked head with the true one.

    Args:
        truth: Head and cameras.
        track: The same as they were tracked.
        case: Name of the measurements.

    Yields:
        Errors of the parts of the face; slopes of the gaps, if there is more than one frame; the focal length over the
        true one, and over the first guess.
    """
    heads = pose_frames(track.head.model, track.head.parameters)
    true = truth.vertices()[[0] if track.one_moment else track.kept]
    vertices = face_vertices(truth.model, neutral(truth.model, truth.parameters[0]))
    face = vertices["face"]
    scale, rotation, shift = umeyama(heads[:, face].reshape(-1, 3), true[:, face].reshape(-1, 3))
    moved = scale * heads @ rotation.T + shift
    of_frames = [umeyama(head[face], posed[face]) for head, posed in zip(heads, true, strict=True)]
    moved_each = np.stack([s * head @ r.T + t for head, (s, r, t) in zip(heads, of_frames, strict=True)])
    for name, part in vertices.items():
        for alignment, found in (("one similarity", moved), ("one of each frame", moved_each)):
            error = np.linalg.norm(found[:, part] - true[:, part], axis=2).mean()
            yield Measurement(case, f"{name}, {alignment}", "mm", 1e3 * float(error))
    if len(heads) > 1:
        for name, pairs in GAPS.items():
            found, wanted = mean_opening(truth, moved_each, true, track.kept, pairs)
            yield Measurement(case, f"slope of the gap between {name}", "", float(np.polyfit(wanted, found, 1)[0]))
    focal = truth.cameras[0][int(track.cameras[0]) if len(truth.cameras[0]) > 1 else 0].fx
    yield Measurement(case, "focal length over the true one", "", float(track.head.cameras.focal[0]) / focal)
    yield Measurement(case, "its first guess over the true one", "", float(track.focal_guesses[0]) / focal)


def measure(kind: str, filmed: Filmed, focal_lengths: Sequence[str] = FOCAL_LENGTHS) -> Iterator[Measurement]:
    """Track footage with both kinds of landmarks.

    Args:
        kind: One of `evaluation.benchmarks.footage.scenes.KINDS`.
        filmed: The footage.
        focal_lengths: Some of `FOCAL_LENGTHS`.

    Yields:
        What `compared` yields.
    """
    truth = filmed.truth
    for name, noise in ERRORS.items():
        recordings = oracle_recordings(filmed, noise)
        for how in focal_lengths:
            track = tracked(recordings, truth.model, kind, truth.cameras[0][0].fx if how == "stated" else None)
            yield from compared(truth, track, f"{kind}, {name}, focal length {how}")


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("--kinds", nargs="+", choices=tuple(KINDS), default=[*KINDS])
    parser.add_argument("--focal-lengths", nargs="+", choices=FOCAL_LENGTHS, default=FOCAL_LENGTHS)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--dataset", type=Path, help="frames of this dataset in place of the toy")
    parser.add_argument("--head-model", type=Path, help="of the dataset")
    task = parser.parse_args()
    if task.dataset is None:
        subject, talk = toy_subject(), Talk(task.seconds, Track().frame_rate, seed=SEED)
        footage = ((kind, filmed_toy(subject, kind, talk)) for kind in task.kinds)
    else:
        capture = read_dataset(task.dataset, task.head_model)
        footage = ((kind, filmed_dataset(capture, kind)) for kind in task.kinds)
    write_measurements(
        task.rows, (row for kind, filmed in footage for row in measure(kind, filmed, task.focal_lengths))
    )


if __name__ == "__main__":
    run(main)
