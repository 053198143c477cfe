"""The light of a capture, fitted to its frames, and how a caricature's shading differs from the frame's under it.

Light comes from a fixed set of directions; a vertex gets the cosine of those that reach it (transfer), and a share of
what it would get from hidden ones (light from skin to skin).  Colour in linear light = albedo x transfer @ light.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy.optimize import nnls

from carigs.capture import Camera, look_at
from carigs.capture.images import to_linear
from carigs.raster import Visibility, project, visible
from carigs.surface.mesh import vertex_normals
from carigs.target import shadow
from carigs.target.registration import sample, well_seen

DIRECTIONS = 64
SIDE = 160  # pixels of a shadow map
BIAS = 0.0015  # metres: shadows are looked for this far off the surface
TOLERANCE = 0.003  # metres
ROUNDS = 5  # of light, then albedo
RIDGE = 0.01  # of the mean eigenvalue
PRIOR = 0.001  # of one observation: albedo is that of most of the skin where nothing was seen

GAMMA = 2.2  # of sRGB, about

Transfer = Float32[np.ndarray, "v k"]


class Observation(NamedTuple):
    """Colours of the skin at one timestep."""

    transfer: Transfer
    colour: Float64[np.ndarray, "v 3"]
    """Linear; mean over the cameras."""
    weight: Float64[np.ndarray, "v"]
    """Sum of the cameras' cosines; 0 where none sees the vertex."""


def transfer(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Transfer:
    """How much light of each direction reaches each vertex (metres); the last column is what the head itself hides."""
    normals = vertex_normals(vertices, faces)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = 1.02 * float(np.linalg.norm(vertices - middle, axis=1).max())
    lifted = vertices + BIAS * normals
    found = np.zeros((len(vertices), DIRECTIONS + 1), np.float32)
    cosines = np.maximum(np.einsum("vk,dk->dv", normals, fibonacci_sphere(DIRECTIONS)), 0)
    for d, direction in enumerate(fibonacci_sphere(DIRECTIONS)):
        lamp = _lamp(middle, radius, direction)
        nearness = visible(vertices, faces, lamp).nearness
        shadow.add_lit(found, d, *project(lifted, lamp), cosines[d], nearness, TOLERANCE)
    total = np.maximum(cosines.sum(axis=0), 1e-9)
    found[:, -1] = 1 - found[:, :-1].sum(axis=1) / total
    found[:, :-1] *= 4 / DIRECTIONS  # unit light from everywhere comes to 1
    return found


def _lamp(middle: Float[np.ndarray, "3"], radius: float, direction: Float[np.ndarray, "3"]) -> Camera:
    """A camera far away whose square image holds a ball: nearly parallel rays."""
    distance = 14.0 * radius
    up = np.array([0.0, 1.0, 0.0] if abs(direction[1]) < 0.9 else [0.0, 0.0, 1.0])
    focal = 0.5 * SIDE / radius * distance * 0.997
    return Camera(look_at(middle + distance * direction, middle, up), focal, focal, 0.5 * SIDE, 0.5 * SIDE, SIDE, SIDE)


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
    return Observation(transfer(vertices, faces), total / np.maximum(weight, 1e-9)[:, None], weight)


def fit_light(observations: list[Observation]) -> Float64[np.ndarray, "k 3"]:
    """Light and albedo by turns, least squares; no direction's light is negative.

    Scaled so that the median of the skin's albedo is about its median colour: only ratios of irradiance matter.
    """
    light = np.zeros((DIRECTIONS + 1, 3))
    if not any((o.weight > 0).any() for o in observations):
        return light
    middle = np.median(np.concatenate([o.colour[o.weight > 0] for o in observations]), axis=0)
    albedo = np.ones((len(observations[0].weight), 3))
    for _ in range(ROUNDS):
        light = np.stack([_fit_channel(observations, albedo[:, c], c, middle[c]) for c in range(3)], axis=1)
        above, below = np.full(albedo.shape, PRIOR), np.full(albedo.shape, PRIOR)
        for o in observations:
            irradiance, weight = o.transfer @ light, np.minimum(o.weight, 2)[:, None]
            above += weight * irradiance * o.colour / middle
            below += weight * irradiance**2
        albedo = above / below
    return light


def _fit_channel(
    observations: list[Observation], albedo: Float64[np.ndarray, "v"], channel: int, middle: float
) -> Float64[np.ndarray, "k"]:
    matrix, right = np.zeros((DIRECTIONS + 1, DIRECTIONS + 1)), np.zeros(DIRECTIONS + 1)
    for o in observations:
        used = o.weight > 0
        design = o.transfer[used] * albedo[used, None]
        weighted = design * np.minimum(o.weight[used], 2)[:, None]
        matrix += weighted.T @ design
        right += weighted.T @ (o.colour[used, channel] / middle)
    matrix += RIDGE * np.trace(matrix) / len(matrix) * np.eye(len(matrix))
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

    light: Float64[np.ndarray, "k 3"]
    strength: float
    """Power to which the ratio of irradiances is taken: below 1, since a fit of diffuse light knows neither gloss nor
    what scatters within the skin."""
    limit: float
    """Largest factor, and its inverse the smallest, on linear colours."""
    kept: Bool[np.ndarray, "f"]
    """Triangles whose colours do not follow."""

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
        return Shading(archive["light"], float(archive["strength"]), float(archive["limit"]), archive["kept"])


def fibonacci_sphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Evenly spread unit vectors (Gonzalez 2010)."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle, radius = np.pi * (3 - np.sqrt(5)) * np.arange(n), np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
