"""How accurate a detector's landmarks are on synthetic footage, without a table that says where they lie on the head.

The landmarks of all frames are cast onto the posed head of the truth. A landmark that always marks the same point of
the skin hits the same place in all frames: its spread is the detector's error, whatever the place is.

Example:
    carigs landmarks talk/0.mp4 -o landmarks.npz
    python -m evaluation.benchmarks.footage.landmark_spread rows.csv --truth talk --landmarks landmarks.npz
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Float, Int

from carigs.capture.camera import Camera
from carigs.detection import mesh_indices
from carigs.fitting.landmarks.files import read_landmarks
from carigs.head import SurfacePoints
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import size
from evaluation.benchmarks.footage.truth import FootageTruth
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

REGIONS: dict[str, tuple[int, ...]] = {
    "lips": mesh_indices.LIPS,
    "eyes": mesh_indices.LEFT_EYE + mesh_indices.RIGHT_EYE,
    "irises": mesh_indices.LEFT_IRIS + mesh_indices.RIGHT_IRIS,
    "brows": mesh_indices.LEFT_BROW + mesh_indices.RIGHT_BROW,
    "nose": mesh_indices.NOSE,
    "jaw line": mesh_indices.JAW_LINE,
}
LEAST_HITS = 5
"""Frames that must hit the head for a landmark to have a place on it."""


class Spread(NamedTuple):
    """Where landmarks lie on the head, and how far they are from there."""

    points: SurfacePoints
    pixels: Float[np.ndarray, "t p"]
    """Distance in each frame's image; NaN where there is no landmark."""


def landmark_spread(truth: FootageTruth, landmarks: Float[np.ndarray, "t p 3"], camera: int = 0) -> Spread:
    """Find the place of each landmark on the head, and its distance from there in each frame.

    Args:
        truth: Head and cameras.
        landmarks: x, y in pixels and confidence, which is 0 where there is no landmark.
        camera: Number of the camera that sees them.

    Returns:
        The places, and the distances.
    """
    rest, faces = truth.model.v_template.astype(np.float64), truth.model.faces
    vertices = truth.vertices()
    cameras = [seen[camera] for seen in truth.cameras]
    hits = np.full((*landmarks.shape[:2], 3), np.nan)
    for t, seen in enumerate(cameras):
        face, weights = _cast(vertices[t], faces, seen, landmarks[t, :, :2])
        on_head = (face >= 0) & (landmarks[t, :, 2] > 0)
        hits[t, on_head] = np.einsum("pk,pka->pa", weights[on_head], rest[faces[face[on_head]]])
    points = _median_places(hits, rest, faces)
    pixels = np.full(landmarks.shape[:2], np.nan)
    for t, seen in enumerate(cameras):
        apart = np.linalg.norm(seen.project(points.interpolate(vertices[t]))[0] - landmarks[t, :, :2], axis=1)
        pixels[t] = np.where(landmarks[t, :, 2] > 0, apart, np.nan)
    return Spread(points, pixels)


def _cast(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, pixels: Float[np.ndarray, "p 2"]
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Faces (-1: none) and barycentric coordinates that rays through an image hit."""
    fx, fy, cx, cy = camera.intrinsics
    rays = np.column_stack([(pixels - (cx, cy)) / (fx, fy), np.ones(len(pixels))]) @ camera.camera_from_world[:3, :3]
    origins = np.tile(camera.centre / size(vertices, faces), (len(rays), 1))
    face, _, weights = RayCaster(vertices, faces).first_hit(origins, rays / np.linalg.norm(rays, axis=1)[:, None])
    return face, weights


def _median_places(
    hits: Float[np.ndarray, "t p 3"], rest: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> SurfacePoints:
    """The point of the rest surface nearest to the median of the hits."""
    enough = np.isfinite(hits).all(axis=-1).sum(axis=0) >= LEAST_HITS
    medians = np.zeros(hits.shape[1:])
    medians[enough] = np.nanmedian(hits[:, enough], axis=0)
    _, face, nearest = igl.point_mesh_squared_distance(medians, rest, faces.astype(np.int64))
    corners = faces[face].astype(np.int64)
    weights = igl.barycentric_coordinates(nearest, *(np.ascontiguousarray(rest[corners[:, k]]) for k in range(3)))
    weights[~enough] = np.nan
    return SurfacePoints(corners, weights)


def main() -> None:
    """Write the errors of each region."""
    parser = csv_parser(__doc__)
    parser.add_argument("--truth", type=Path, required=True, help="folder of the footage")
    parser.add_argument("--landmarks", type=Path, required=True, help="what `carigs landmarks` wrote for camera 0")
    task = parser.parse_args()
    truth, landmarks = FootageTruth.load(task.truth), read_landmarks(task.landmarks)
    values = landmarks.at(range(len(truth.parameters)), landmarks.cameras[:1].tolist())[:, 0]
    pixels = landmark_spread(truth, values).pixels
    write_measurements(task.rows, _errors_of_regions(pixels))


def _errors_of_regions(pixels: Float[np.ndarray, "t p"]) -> Iterator[Measurement]:
    for region, points in REGIONS.items():
        of_region = pixels[:, [point for point in points if point < pixels.shape[1]]]
        yield Measurement(region, "median error", "px", float(np.nanmedian(of_region)))
        yield Measurement(region, "error of one in ten above", "px", float(np.nanpercentile(of_region, 90)))


if __name__ == "__main__":
    run(main)
