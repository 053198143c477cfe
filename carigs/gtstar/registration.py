"""Registration of frames to the mesh: by how many pixels an image is shifted against the other cameras' images."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import Visibility
from carigs.raster.vertex_colours import sample_colours, visible_vertices

MIN_VERTICES = 100
"""Least number of vertices shared with other cameras for an error to be measured."""
Key = TypeVar("Key", bound=Hashable)


class RegistrationError(NamedTuple):
    """Difference of a frame from the other cameras of its timestep at the same vertices."""

    pixels: float
    """Length of the image shift that explains most of the difference (least squares)."""
    residual: float
    """Mean absolute difference of colours."""


def registration_errors(
    views: Mapping[Key, tuple[Float32[np.ndarray, "h w 3"], Visibility]],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> dict[Key, RegistrationError]:
    """Registration error of each image of one timestep.

    To first order, a shift s changes the colour c at a vertex by s . grad(c). The shift solves min_s sum |d - s .
    grad(c)|^2, where d is the difference to the mean of the other cameras (Lucas and Kanade 1981, one step).

    Args:
        views: Images, and what their cameras see of the mesh.
        vertices: World points in metres.
        faces: Vertex indices of the triangles.

    Returns:
        Errors, without the images that share fewer than `MIN_VERTICES` vertices with the others.
    """
    normals = vertex_normals(vertices, faces)
    total, count = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    samples = {}
    for key, (image, visibility) in views.items():
        seen = visible_vertices(visibility, vertices, normals)
        colours, gradients = sample_colours(image, seen.pixels)
        samples[key] = seen.index, colours, gradients
        np.add.at(total, seen.index, colours)
        count[seen.index] += 1
    errors = {}
    for key, (index, colours, gradients) in samples.items():
        others = count[index] - 1
        shared = others > 0
        if shared.sum() < MIN_VERTICES:
            continue
        mean = (total[index[shared]] - colours[shared]) / others[shared, None]
        difference = (mean - colours[shared]).ravel()
        shift = np.linalg.lstsq(gradients[shared].reshape(-1, 2), difference, rcond=None)[0]
        errors[key] = RegistrationError(float(np.linalg.norm(shift)), float(np.abs(difference).mean()))
    return errors
