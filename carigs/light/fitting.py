"""The light of a capture, fitted to its frames, and how a caricature's shading differs from the frame's under it.

Light comes from a number of directions; a vertex gets the cosine of those that reach it (transfer), and a share of
what it would get from hidden ones (light from skin to skin).  Colour in linear light = albedo x transfer @ light.
A first look at many directions tells the brightest, which the fit and all shading go on with: a shadow map per
direction and surface is what light costs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

from carigs.capture import Camera
from carigs.capture.images import to_linear
from carigs.gtstar.registration import sample, well_seen
from carigs.light import shadow_map as shadow
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import Visibility, visible

CANDIDATES = 256  # directions of the first look
BRIGHTEST = 64  # that are gone on with
SIDE = 160  # pixels of a shadow map
BIAS = 0.0015  # metres: shadows are looked for this far off the surface
TOLERANCE = 0.003  # metres
EVERY = 4  # vertex, of those that the light is fitted to
FIRST_TIMESTEPS = 3  # of those given, for the first look
FIRST_ROUNDS, ROUNDS = 2, 30  # of light, then albedo: they converge slowly, since each explains most of the other
RIDGE = 0.001  # of the mean eigenvalue
PRIOR = 0.001  # of one observation: albedo is that of most of the skin where nothing was seen

GAMMA = 2.2  # of sRGB, about

Transfer = Float32[np.ndarray, "v k"]


class Observation(NamedTuple):
    """Colours of the skin at one timestep."""

    vertices: Float[np.ndarray, "v 3"]
    colour: Float64[np.ndarray, "v 3"]
    """Linear; mean over the cameras."""
    weight: Float64[np.ndarray, "v"]
    """Sum of the cameras' cosines; 0 where none sees the vertex."""


def transfer(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], directions: Float[np.ndarray, "d 3"]
) -> Transfer:
    """How much light of each direction reaches each vertex (metres); the last column is what the head itself hides.

    `directions` are unit vectors towards the light, in world axes.
    """
    normals = vertex_normals(vertices, faces)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = 1.02 * float(np.linalg.norm(vertices - middle, axis=1).max())
    cosines = np.maximum(directions @ normals.T, 0).astype(np.float32)
    found = np.zeros((len(directions) + 1, len(vertices)), np.float32)
    points = np.concatenate([vertices - middle, vertices - middle + BIAS * normals]).astype(np.float32)
    scale = 0.5 * SIDE / radius
    for d, direction in enumerate(directions):
        map_from_world = _map_from_world(direction) * np.array([[scale], [scale], [1]])
        on_map = points @ map_from_world.T.astype(np.float32) + np.float32([0.5 * SIDE, 0.5 * SIDE, 0])
        surface, lifted = np.split(on_map, 2)
        shadow.light_up(found[d], surface, faces, lifted, cosines[d], SIDE, TOLERANCE)
    found[-1] = 1 - found[:-1].sum(axis=0) / np.maximum(cosines.sum(axis=0), 1e-9)
    found[:-1] *= 4 / len(directions)  # unit light from everywhere comes to 1
    return found.T


def _map_from_world(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation to the axes of a direction's shadow map: the third points away from the light."""
    beside = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    beside /= np.linalg.norm(beside)
    return np.stack([np.cross(direction, beside), beside, -direction])


def observe(
    views: Iterable[tuple[Float32[np.ndarray, "h w 3"], Camera]],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    skin: Bool[np.ndarray, "v"],
) -> Observation:
    """Mean colour of every vertex of the `skin` over the images of one timestep, weighted by the cosine of the view."""
    normals = vertex_normals(vertices, faces)
    total, weight = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for image, camera in views:
        seen = well_seen(visible(vertices, faces, camera), vertices, normals)
        colour, _ = sample(image, seen.pixel)
        cosine = np.where(skin[seen.vertex], seen.cosine, 0)
        total[seen.vertex] += cosine[:, None] * to_linear(colour)
        weight[seen.vertex] += cosine
    return Observation(vertices, total / np.maximum(weight, 1e-9)[:, None], weight)


def fit_light(
    observations: list[Observation], faces: Int[np.ndarray, "f 3"], run: Callable = map
) -> tuple[Float64[np.ndarray, "d 3"], Float64[np.ndarray, "k 3"]]:
    """The brightest directions and the light from each, the last row that of the head itself (`transfer`).

    Least squares by turns with an albedo per vertex; no direction's light is negative.  Scaled so that the median of
    the skin's albedo is about its median colour: only ratios of irradiance matter.  `run` is `map`, or that of an
    executor.
    """
    observations = [o for o in observations if (o.weight[::EVERY] > 0).any()]
    if not observations:
        return fibonacci_sphere(BRIGHTEST), np.zeros((BRIGHTEST + 1, 3))

    def fit(
        chosen: list[Observation], directions: Float64[np.ndarray, "d 3"], rounds: int
    ) -> Float64[np.ndarray, "k 3"]:
        reach = list(run(lambda o: transfer(o.vertices, faces, directions)[::EVERY], chosen))
        return _fit(reach, [o.colour[::EVERY] for o in chosen], [o.weight[::EVERY] for o in chosen], rounds)

    candidates = fibonacci_sphere(CANDIDATES)
    with threadpool_limits(1, "blas"):  # on several threads it would add in another order, and wait for busy cores
        light = fit(observations[:: max(1, len(observations) // FIRST_TIMESTEPS)], candidates, FIRST_ROUNDS)
        directions = candidates[np.sort(np.argsort(-light[:-1].sum(axis=1))[:BRIGHTEST])]
        return directions, fit(observations, directions, ROUNDS)


def _fit(
    reach: list[Transfer],
    colours: list[Float64[np.ndarray, "v 3"]],
    weights: list[Float64[np.ndarray, "v"]],
    rounds: int,
) -> Float64[np.ndarray, "k 3"]:
    """Light and albedo by turns."""
    middle = np.median(np.concatenate([c[w > 0] for c, w in zip(colours, weights, strict=True)]), axis=0)
    samples = [
        (r.astype(np.float64), c / middle, np.minimum(w, 2)[:, None])
        for r, c, w in zip(reach, colours, weights, strict=True)
    ]
    albedo = np.ones(colours[0].shape)
    for _ in range(rounds):
        light = np.stack([_fit_channel(samples, albedo[:, c], c) for c in range(3)], axis=1)
        above, below = np.full(albedo.shape, PRIOR), np.full(albedo.shape, PRIOR)
        for transfers, colour, weight in samples:
            irradiance = transfers @ light
            above += weight * irradiance * colour
            below += weight * irradiance**2
        albedo = above / below
    return light


def _fit_channel(
    samples: list[tuple[np.ndarray, np.ndarray, np.ndarray]], albedo: Float64[np.ndarray, "v"], channel: int
) -> Float64[np.ndarray, "k"]:
    size = samples[0][0].shape[1]
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for transfers, colour, weight in samples:
        design = transfers * (albedo[:, None] * np.sqrt(weight))
        matrix += design.T @ design
        right += design.T @ (colour[:, channel] * np.sqrt(weight[:, 0]))
    matrix += RIDGE * np.trace(matrix) / size * np.eye(size)
    factor = np.linalg.cholesky(matrix)
    return nnls(factor.T, np.linalg.solve(factor, right))[0]


def gain(
    light: Float64[np.ndarray, "k 3"], natural: Transfer, caricature: Transfer, strength: float, limit: float
) -> Float64[np.ndarray, "v 3"]:
    """Factor on linear colours that takes the natural surface's shading to the caricature's.

    The ratio of irradiances to the power `strength`, between 1 / `limit` and `limit`.
    """
    floor = 1e-3 * max(float(light.sum(axis=0).max()), 1e-9)
    ratio = np.maximum(caricature @ light, floor) / np.maximum(natural @ light, floor)
    return np.clip(ratio**strength, 1 / limit, limit)


@dataclass(frozen=True)
class Shading:
    """The light of a capture, and how far a surface's shading follows it."""

    directions: Float64[np.ndarray, "d 3"]
    light: Float64[np.ndarray, "k 3"]
    strength: float
    """Power to which the ratio of irradiances is taken: below 1, since a fit of diffuse light knows neither gloss nor
    what scatters within the skin."""
    limit: float
    """Largest factor, and its inverse the smallest, on linear colours."""
    kept: Bool[np.ndarray, "f"]
    """Triangles whose colours do not follow."""

    def transfer(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Transfer:
        """`transfer` of its directions."""
        return transfer(vertices, faces, self.directions)

    def factor(self, before: Transfer, after: Transfer) -> Float64[np.ndarray, "v 3"]:
        """`gain` of every vertex from one posed surface to another."""
        return gain(self.light, before, after, self.strength, self.limit)

    def of_faces(self, before: Transfer, after: Transfer, faces: Int[np.ndarray, "f 3"]) -> Float32[np.ndarray, "f 3"]:
        """Factor on the sRGB values of each triangle: the mean of its corners' through the curve's exponent."""
        factor = self.factor(before, after)[faces].mean(axis=1) ** (1 / GAMMA)
        return np.where(self.kept[:, None], 1, factor).astype(np.float32)


def relight(
    colour: Float32[np.ndarray, "h w 3"],
    caricature: Visibility,
    of_vertices: Float64[np.ndarray, "v 3"],
    except_faces: Bool[np.ndarray, "f"],
) -> Float32[np.ndarray, "h w 3"]:
    """Multiply what is seen of the mesh by a factor per vertex, in linear light; some faces keep their colours."""
    fragments = caricature.fragments
    return shadow.relit(
        np.ascontiguousarray(colour), fragments.face, fragments.barycentric, caricature.faces,
        of_vertices.astype(np.float32), except_faces,
    )  # fmt: skip


def save_shading(file: Path, shading: Shading) -> None:
    """Write the .npz."""
    np.savez(file, **asdict(shading))


def load_shading(file: Path) -> Shading | None:
    """Read what `save_shading` wrote; None if there is no such file."""
    if not file.is_file():
        return None
    with np.load(file) as archive:
        return Shading(
            archive["directions"],
            archive["light"],
            float(archive["strength"]),
            float(archive["limit"]),
            archive["kept"],
        )


def fibonacci_sphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Evenly spread unit vectors (Gonzalez 2010)."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle, radius = np.pi * (3 - np.sqrt(5)) * np.arange(n), np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
