"""Fit distant light to the colours of skin in the frames of a capture.

The model is diffuse: colour in linear light = albedo x (transfer @ light), with `light_transfer` at each timestep, one
albedo per vertex and one light per capture. Light and albedo are fitted in turn by least squares. Shadow maps cost time
per direction, so a coarse fit to many directions selects the brightest, and the final fit and all shading use only
those.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

from carigs.capture.images import to_linear
from carigs.light.transfer import Transfer, fibonacci_sphere, light_transfer
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import Visibility
from carigs.raster.vertex_colours import sample_colours, visible_vertices

CANDIDATES = 256  # directions of the coarse fit
DIRECTIONS = 64  # the brightest of them, which the final fit and all shading use
VERTEX_STRIDE = 4  # of the vertices that the fit uses
COARSE_TIMESTEPS = 3
COARSE_ROUNDS, ROUNDS = 2, 30  # of light, then albedo; convergence is slow because each can explain most of the other
RIDGE = 0.001  # Tikhonov weight over the mean eigenvalue of the normal matrix
ALBEDO_PRIOR = 0.001  # weight, in observations, of the median albedo: it decides where a vertex was never observed


class Observation(NamedTuple):
    """Colours of the skin at one timestep."""

    vertices: Float[np.ndarray, "v 3"]
    """World points in metres."""
    colour: Float64[np.ndarray, "v 3"]
    """Linear; weighted mean over the cameras."""
    weight: Float64[np.ndarray, " v"]
    """Sum of the cosines between normal and view over the cameras; 0 where no camera sees the vertex."""


def observe_skin(
    views: Iterable[tuple[Float32[np.ndarray, "h w 3"], Visibility]],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    skin: Bool[np.ndarray, " v"],
) -> Observation:
    """Mean colour of every skin vertex over the images of one timestep, weighted by the cosine of the view.

    Args:
        views: Images, and what their cameras see of the mesh.
        vertices: World points in metres.
        faces: Vertex indices of the triangles.
        skin: Vertices to observe.

    Returns:
        Linear colours and weights.
    """
    normals = vertex_normals(vertices, faces)
    total, weight = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for image, visibility in views:
        seen = visible_vertices(visibility, vertices, normals)
        colour, _ = sample_colours(image, seen.pixels)
        cosine = np.where(skin[seen.index], seen.cosine, 0)
        total[seen.index] += cosine[:, None] * to_linear(colour)
        weight[seen.index] += cosine
    return Observation(vertices, total / np.maximum(weight, 1e-9)[:, None], weight)


def fit_light(
    observations: list[Observation],
    faces: Int[np.ndarray, "f 3"],
    map_timesteps: Callable = map,
    num_directions: int = DIRECTIONS,
) -> tuple[Float64[np.ndarray, "d 3"], Float64[np.ndarray, "k 3"]]:
    """Fit the light of a capture by alternating least squares; the light of each direction is not negative.

    The scale is such that the median albedo of the skin is about its median colour. Only ratios of irradiance are used
    later, so that the scale does not matter.

    Args:
        observations: Colours of the skin at several timesteps.
        faces: Vertex indices of the triangles.
        map_timesteps: `map`, or that of an executor; the result does not depend on it.
        num_directions: Number d of directions of the result, at most `CANDIDATES`.

    Returns:
        The brightest directions (d, 3), and the light from each as rows of (d + 1, 3), the last one for light that the
        head reflects (see `light_transfer`). The light is 0 if nothing was observed.
    """
    observations = [o for o in observations if (o.weight[::VERTEX_STRIDE] > 0).any()]
    if not observations:
        return fibonacci_sphere(num_directions), np.zeros((num_directions + 1, 3))

    def fit(
        subset: list[Observation], directions: Float64[np.ndarray, "d 3"], rounds: int
    ) -> Float64[np.ndarray, "k 3"]:
        transfers = map_timesteps(lambda o: light_transfer(o.vertices, faces, directions)[::VERTEX_STRIDE], subset)
        colours, weights = [o.colour[::VERTEX_STRIDE] for o in subset], [o.weight[::VERTEX_STRIDE] for o in subset]
        return _fit(list(transfers), colours, weights, rounds)

    candidates = fibonacci_sphere(CANDIDATES)
    with threadpool_limits(1, "blas"):  # the order of additions would depend on the number of BLAS threads
        light = fit(observations[:: max(1, len(observations) // COARSE_TIMESTEPS)], candidates, COARSE_ROUNDS)
        directions = candidates[np.sort(np.argsort(-light[:-1].sum(axis=1))[:num_directions])]
        return directions, fit(observations, directions, ROUNDS)


def _fit(
    transfers: list[Transfer],
    colours: list[Float64[np.ndarray, "v 3"]],
    weights: list[Float64[np.ndarray, " v"]],
    rounds: int,
) -> Float64[np.ndarray, "k 3"]:
    """Light and albedo in turn."""
    median = np.median(np.concatenate([c[w > 0] for c, w in zip(colours, weights, strict=True)]), axis=0)
    median = np.where(median > 0, median, 1)  # a channel that is black almost everywhere keeps its unit
    samples = [
        (t.astype(np.float64), c / median, np.minimum(w, 2)[:, None])
        for t, c, w in zip(transfers, colours, weights, strict=True)
    ]
    albedo = np.ones(colours[0].shape)
    for _ in range(rounds):
        light = np.stack([_fit_channel(samples, albedo[:, c], c) for c in range(3)], axis=1)
        numerator, denominator = np.full(albedo.shape, ALBEDO_PRIOR), np.full(albedo.shape, ALBEDO_PRIOR)
        for transfer, colour, weight in samples:
            irradiance = transfer @ light
            numerator += weight * irradiance * colour
            denominator += weight * irradiance**2
        albedo = numerator / denominator
    return light


def _fit_channel(
    samples: list[tuple[np.ndarray, np.ndarray, np.ndarray]], albedo: Float64[np.ndarray, " v"], channel: int
) -> Float64[np.ndarray, " k"]:
    """Non-negative least squares for the light of one colour channel, on the Cholesky factor of the normal matrix."""
    size = samples[0][0].shape[1]
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for transfer, colour, weight in samples:
        design = transfer * (albedo[:, None] * np.sqrt(weight))
        matrix += design.T @ design
        right += design.T @ (colour[:, channel] * np.sqrt(weight[:, 0]))
    if not np.trace(matrix) > 0:  # everything that was observed is in shadow from all directions, or black
        return np.zeros(size)
    matrix += RIDGE * np.trace(matrix) / size * np.eye(size)
    factor = np.linalg.cholesky(matrix)
    return nnls(factor.T, np.linalg.solve(factor, right))[0]
