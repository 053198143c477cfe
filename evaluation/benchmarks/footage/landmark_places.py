"""Where MediaPipe's landmarks are placed on a head, against where they were detected; and what this costs a fit.

Distances are those of `register_landmarks`, which `carigs head embed` uses for heads that carigs does not know, on the
neutral head. A fit gets landmarks of the true mesh in all views of a dataset, with noise of one pixel; they lie where
the first name says, and the fit believes that they lie where the second one says.

Example:
    python -m evaluation.benchmarks.footage.landmark_places rows.csv --dataset ict_s7 --head-model ict_model.npz \
        --detected real/ict_mediapipe_embedding.npz
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture, read_dataset
from carigs.capture.evenly_spread import evenly_spread
from carigs.detection.mesh_indices import COUNT, JAW_LINE, REGIONS
from carigs.embedding import register_landmarks
from carigs.embedding.canonical_face import IBUG_INNER
from carigs.fitting.footage import frame_projections
from carigs.fitting.landmarks.embedding import JAW_LINE as IBUG_JAW_LINE
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.fitting.landmarks.fit import Observations, fit_landmarks
from carigs.fitting.triangulation import project
from carigs.head import HeadModel, SurfacePoints, pose, pose_frames
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

NOISE = 1.0
"""Pixels per axis."""


def distances(model: HeadModel, detected: Path) -> Iterator[Measurement]:
    """Compare places on the neutral head.

    Args:
        model: The head model.
        detected: Embedding of the places where landmarks were detected.

    Yields:
        Median and 90 % of all landmarks, and medians of the parts of the face.
    """
    found = register_landmarks(model)
    points, numbers = read_embedding(detected, model, COUNT)
    both = np.intersect1d(found.landmarks, numbers)
    rest = model.v_template.astype(np.float64)
    places = found.points(model).interpolate(rest)[np.searchsorted(found.landmarks, both)]
    order = np.argsort(numbers)
    wanted = points.interpolate(rest)[order[np.searchsorted(numbers[order], both)]]
    apart = 1e3 * np.linalg.norm(places - wanted, axis=1)
    yield Measurement("neutral head", "median distance", "mm", float(np.median(apart)))
    yield Measurement("neutral head", "distance of one in ten above", "mm", float(np.percentile(apart, 90)))
    for name, landmarks in REGIONS.items():
        if (part := np.isin(both, landmarks)).any():
            yield Measurement("neutral head", f"median distance, {name}", "mm", float(np.median(apart[part])))


def fits(capture: Capture, detected: Path | None) -> Iterator[Measurement]:
    """Fit the head of a dataset to its landmarks.

    Args:
        capture: A calibrated dataset with exact parameters, whose head model has 68 landmarks.
        detected: As of `distances`; None to leave out the fit that needs it.

    Yields:
        Mean vertex error of the face of each fit.
    """
    model = capture.model
    assert model.landmarks68 is not None
    found = register_landmarks(model)

    def placed(numbers: np.ndarray) -> SurfacePoints:
        return found.points(model)[np.searchsorted(found.landmarks, numbers)]

    inner = np.isin(IBUG_INNER, found.landmarks)
    own = model.landmarks68[np.flatnonzero(inner) + IBUG_JAW_LINE]
    counterparts = placed(np.array(IBUG_INNER)[inner])
    jaw = np.array(evenly_spread(np.intersect1d(JAW_LINE, found.landmarks).tolist(), IBUG_JAW_LINE))
    cases = {
        "the model's own 68, fitted by the same": (model.landmarks68, model.landmarks68),
        f"{len(jaw) + len(own)} of the registration, fitted by the same": (counterparts.joined(placed(jaw)),) * 2,
        f"{len(own)} of the model's own, fitted by the same": (own, own),
        f"{len(own)} of the model's own, fitted by their counterparts of the registration": (own, counterparts),
        f"{len(own)} of the registration, fitted by the same": (counterparts, counterparts),
    }
    if detected is not None:
        points, numbers = read_embedding(detected, model, COUNT)
        known = np.isin(numbers, found.landmarks)
        cases[f"{known.sum()} as detected, fitted by the registration"] = points[known], placed(numbers[known])
    for name, (true, believed) in cases.items():
        yield Measurement(name, "face", "mm", face_error(capture, true, believed))


def face_error(capture: Capture, true: SurfacePoints, believed: SurfacePoints) -> float:
    """Fit a head to landmarks.

    Args:
        capture: The dataset.
        true: Where the landmarks are.
        believed: Where the fit has them.

    Returns:
        Mean vertex error of the face in millimetres.
    """
    model, timesteps, cameras = capture.model, sorted(capture.parameter_files), sorted(capture.cameras)
    heads: Float[np.ndarray, "t v 3"] = np.stack([pose(model, capture.parameters(t)) for t in timesteps])
    projections = frame_projections(capture, timesteps, cameras)
    pixels, _ = project(np.stack([true.interpolate(head) for head in heads]), projections)
    pixels += NOISE * np.random.default_rng(0).normal(size=pixels.shape)
    sequences = [capture.frame_at[t, cameras[0]].sequence for t in timesteps]
    linked = np.array([a == b for a, b in pairwise(sequences)])
    fit = fit_landmarks(model, believed, Observations(pixels, np.ones(pixels.shape[:3]), projections, linked))
    found = pose_frames(model, fit.parameters(model))
    return 1e3 * float(np.linalg.norm(found - heads, axis=-1)[:, model.vertex_region("face")].mean())


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("--dataset", type=Path, required=True, help="with exact parameters")
    parser.add_argument("--head-model", type=Path, required=True, help="of the dataset")
    parser.add_argument("--detected", type=Path, required=True, help="embedding of detected landmarks")
    task = parser.parse_args()

    def rows() -> Iterator[Measurement]:
        capture = read_dataset(task.dataset, task.head_model)
        yield from distances(capture.model, task.detected)
        yield from fits(capture, task.detected)

    write_measurements(task.rows, rows())


if __name__ == "__main__":
    run(main)
