"""Whether a frame lies where its mesh says: by how many pixels its colours are off those that the other cameras see."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from carigs.capture import Camera
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import Visibility, visible

TOLERANCE = 0.003  # metres
OBLIQUE = 0.3  # cosine below which a view is not asked for colours
FEWEST = 100  # vertices that a comparison takes
Key = TypeVar("Key", bound=Hashable)


class Seen(NamedTuple):
    """Vertices that a camera sees well."""

    vertex: Int[np.ndarray, "n"]
    pixel: Float64[np.ndarray, "n 2"]
    cosine: Float64[np.ndarray, "n"]
    """Between the view and the normal."""


class RegistrationError(NamedTuple):
    """How a frame differs from what the other cameras of its timestep see on the same vertices."""

    pixels: float
    """Length of the shift of the image that explains most of the difference (least squares)."""
    residual: float
    """Mean absolute difference of colours."""


def registration_errors(
    views: Mapping[Key, tuple[Float32[np.ndarray, "h w 3"], Camera]],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> dict[Key, RegistrationError]:
    """The misfit of each image of one timestep; none for an image that shares too little with the others.

    To first order a shift s changes the colour c at a vertex by s.grad(c): s solves min sum |d - s.grad(c)|^2, with d
    the difference to the mean of the other cameras (Lucas and Kanade 1981, one step).
    """
    normals = vertex_normals(vertices, faces)
    total, count = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    found = {}
    for key, (image, camera) in views.items():
        seen = well_seen(visible(vertices, faces, camera), vertices, normals)
        found[key] = seen, *sample(image, seen.pixel)
        np.add.at(total, seen.vertex, found[key][1])
        count[seen.vertex] += 1
    result = {}
    for key, (seen, colour, slope) in found.items():
        others = count[seen.vertex] - 1
        shared = others > 0
        if shared.sum() < FEWEST:
            continue
        mean = (total[seen.vertex[shared]] - colour[shared]) / others[shared, None]
        difference = (mean - colour[shared]).ravel()
        design = slope[shared].reshape(-1, 2)
        shift = np.linalg.lstsq(design, difference, rcond=None)[0]
        result[key] = RegistrationError(float(np.linalg.norm(shift)), float(np.abs(difference).mean()))
    return result


def well_seen(seen: Visibility, vertices: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"]) -> Seen:
    """Vertices that face the camera, and whose pixel, not on the image's border, shows what is at their depth."""
    towards = seen.camera.centre - vertices
    cosine = np.einsum("vk,vk->v", normals, towards) / np.linalg.norm(towards, axis=1)
    size = np.array([seen.camera.width, seen.camera.height])
    depth = seen.points[:, 2]
    inside = (depth > 0) & (cosine > OBLIQUE) & ((seen.pixel > 1.5) & (seen.pixel < size - 2.5)).all(axis=1)
    column, row = np.where(inside[:, None], seen.pixel, 0).astype(int).T
    near = seen.nearness[row, column]
    chosen = np.flatnonzero(inside & (near > 0) & (np.abs(near * depth - 1) < TOLERANCE * near))
    return Seen(chosen, seen.pixel[chosen], cosine[chosen])


def sample(
    image: Float32[np.ndarray, "h w 3"], pixel: Float64[np.ndarray, "n 2"]
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 2"]]:
    """Bilinear colours, and their slope per pixel along x and y, at positions inside the image."""
    x, y = (pixel - 0.5).astype(int).T
    fx, fy = (pixel - 0.5 - np.stack([x, y], axis=1))[:, :, None].transpose(1, 0, 2)
    a, b, c, d = image[y, x], image[y, x + 1], image[y + 1, x], image[y + 1, x + 1]
    colour = (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d)
    return colour, np.stack([(1 - fy) * (b - a) + fy * (d - c), (1 - fx) * (c - a) + fx * (d - b)], axis=2)
