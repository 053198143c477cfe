"""Landmarks by the truth, with the errors that networks make: for tests of trackers without a network.

Four kinds of errors, from what networks leave on real people and on this footage: a landmark marks another point of the
skin than the table of its places says, the same in all frames; it floats before or behind the skin, because the network
takes the nose for longer or the cheeks for flatter than they are, which shows as the head turns; errors in the image
that neighbours and successive frames share; and landmarks that the head itself hides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.signal import lfilter

from carigs.capture.camera import Camera
from carigs.fitting.landmarks.files import Landmarks
from carigs.head import SurfacePoints
from carigs.raster import compute_visibility
from carigs.toy.look.strands import triangle_frames
from evaluation.benchmarks.footage.truth import FootageTruth

HIDDEN = 0.004
"""Metres by which a landmark may lie behind the surface that the camera sees and still count as seen."""


@dataclass(frozen=True)
class LandmarkNoise:
    """Errors of landmarks. All lengths are standard deviations per axis."""

    offset: float = 1.2e-3
    """Metres along the skin, constant in the frame of the triangle that carries the landmark."""
    depth: float = 2e-3
    """Metres along the normal of the skin, constant, and shared by neighbours."""
    shared: float = 0.6
    """Pixels that neighbours on the face share, and successive frames."""
    reach: float = 0.03
    """Metres over which the covariance of what neighbours share falls to 1/e."""
    memory: float = 0.2
    """Seconds after which the shared error has forgotten 1 - 1/e of itself; 0 for frames of their own."""
    own: float = 0.25
    """Pixels that a landmark of a frame shares with no other."""
    missing: float = 0.0
    """Share of landmarks that are left out at random."""
    hide: bool = True
    """Whether landmarks that the head hides have confidence 0; networks place these, too, but badly."""


EXACT = LandmarkNoise(offset=0, depth=0, shared=0, own=0, hide=False)
"""Projections as they are."""


def oracle_landmarks(
    truth: FootageTruth, points: SurfacePoints, noise: LandmarkNoise | None = None, seed: int = 0
) -> Landmarks:
    """Project points of the posed head into all frames.

    Args:
        truth: Head and cameras.
        points: Where the landmarks lie on the head: those of an embedding.
        noise: Errors; None for the usual ones.
        seed: Of the errors.

    Returns:
        Landmarks of all timesteps and cameras; confidence 1, or 0 where one is left out or behind the camera.
    """
    noise = noise or LandmarkNoise()
    rng = np.random.default_rng([seed, 0x0AC1E])
    vertices, faces = truth.vertices(), truth.model.faces
    carrying = carrying_triangles(points, faces)
    factor = _smooth_factor(points.interpolate(truth.model.v_template), noise.reach)
    along = noise.offset * rng.standard_normal((len(points), 2))
    offsets = np.column_stack([along, noise.depth * (factor @ rng.standard_normal(len(points)))])
    values = np.zeros((len(vertices), len(truth.cameras[0]), len(points), 3))
    for c in range(values.shape[1]):
        for t, posed in enumerate(vertices):
            camera = truth.cameras[t][c]
            places = points.interpolate(posed) + np.einsum("pi,pij->pj", offsets, triangle_frames(posed, carrying))
            values[t, c, :, :2], depth = camera.project(places)
            values[t, c, :, 2] = seen(places, posed, faces, camera) if noise.hide else depth > 0
        values[:, c, :, :2] += _image_errors(factor, len(vertices), truth.fps, noise, rng)
    values[rng.random(values.shape[:3]) < noise.missing] = 0
    values[values[..., 2] == 0] = 0
    return Landmarks(values, np.arange(len(vertices)), np.arange(values.shape[1]))


def carrying_triangles(points: SurfacePoints, faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "p 3"]:
    """A triangle that each point lies on.

    Args:
        points: Points of triangles, or vertices.
        faces: Triangles of the mesh.

    Returns:
        Corners: of a vertex, those of one of its triangles.
    """
    if points.corners.shape[1] == 3:
        return points.corners
    of_vertex = np.zeros(faces.max() + 1, int)
    of_vertex[faces] = np.arange(len(faces))[:, None]
    return faces[of_vertex[points.corners[:, 0]]].astype(np.int64)


def seen(
    places: Float[np.ndarray, "p 3"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
) -> Bool[np.ndarray, " p"]:
    """Which points a camera sees: inside the image, and not behind the head.

    Args:
        places: World points in metres.
        vertices: Of the head.
        faces: Of the head.
        camera: The camera.

    Returns:
        Whether each is seen.
    """
    pixels, depth = camera.project(places)
    column, row = np.floor(np.nan_to_num(pixels, nan=-1).clip(-1, 1e6)).astype(int).T
    inside = (depth > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    surface = compute_visibility(vertices, faces, camera).fragments.depth
    return inside & (depth < surface[np.where(inside, row, 0), np.where(inside, column, 0)] + HIDDEN)


def _smooth_factor(rest: Float[np.ndarray, "p 3"], reach: float) -> Float[np.ndarray, "p p"]:
    """What makes independent numbers a field that is smooth along the face, of the same variance."""
    squared = ((rest[:, None] - rest) ** 2).sum(axis=-1)
    return np.linalg.cholesky(np.exp(-squared / reach**2) + 1e-6 * np.eye(len(rest)))


def _image_errors(
    factor: Float[np.ndarray, "p p"], count: int, fps: float, noise: LandmarkNoise, rng: np.random.Generator
) -> Float[np.ndarray, "t p 2"]:
    """Gaussian errors in pixels: autoregressive fields that are smooth along the face, and white noise."""
    kept = np.exp(-1 / (fps * noise.memory)) if noise.memory else 0.0
    fields = np.einsum("pq,tqa->tpa", factor, rng.standard_normal((count, len(factor), 2)))
    fields[1:] *= np.sqrt(1 - kept**2)  # so that all frames have the same variance
    shared = lfilter([1.0], [1.0, -kept], fields, axis=0)
    return noise.shared * shared + noise.own * rng.standard_normal(shared.shape)
