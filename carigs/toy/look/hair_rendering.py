"""Rendering of hair strands: camera-facing ribbons of triangles, shaded at their vertices."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Float32, Int32

from carigs.toy.look.hair import Strands
from carigs.toy.look.lighting import KEY_COLOUR, StudioLight


def ribbon_faces(strands: int, knots: int, first: int) -> Int32[np.ndarray, "f 3"]:
    """Faces of the ribbons: two triangles between neighbouring knots, two vertices to a knot.

    Args:
        strands: Number of strands.
        knots: Points of a strand.
        first: Index of the first vertex.

    Returns:
        Vertex indices.
    """
    row = first + 2 * (np.arange(strands)[:, None] * knots + np.arange(knots - 1)).reshape(-1)
    return np.concatenate(
        [np.stack([row, row + 1, row + 2], axis=1), np.stack([row + 1, row + 3, row + 2], axis=1)]
    ).astype(np.int32)


def strand_ribbons(
    strands: Strands,
    colour: Float[np.ndarray, "s 3"],
    roots: Float[np.ndarray, "s 3"],
    axes: Float[np.ndarray, "s 3 3"],
    unit: float,
    eye: Float[np.ndarray, "3"],
    light: StudioLight,
) -> tuple[Float[np.ndarray, "r 3"], Float32[np.ndarray, "r 3"]]:
    """Vertices of the ribbons and their colours, with the diffuse and specular terms of Kajiya and Kay (1989).

    Args:
        strands: The strands.
        colour: Their linear colours.
        roots: World positions of their roots, in metres.
        axes: Frames of the triangles that they are bound to, in world axes (see `triangle_frames`).
        unit: Length in metres of the unit of `strands`.
        eye: World position of the camera that the ribbons face, in metres.
        light: The light of the studio.

    Returns:
        Positions in metres and linear colours of the vertices.
    """
    toward = np.maximum(0.35 + 0.65 * (np.ascontiguousarray(axes[:, 2]) @ light.key_direction), 0.0)
    return _strand_ribbons(
        strands.local, strands.width, strands.shade, colour, roots, axes, unit, eye, light.key_direction, KEY_COLOUR,
        toward, light.ambient(np.ascontiguousarray(axes[:, 2])),
    )  # fmt: skip


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _strand_ribbons(local, width, shade, colour, roots, axes, unit, eye, key, key_colour, toward, ambient):
    n, knots = local.shape[:2]
    positions, colours = np.empty((2 * n * knots, 3)), np.empty((2 * n * knots, 3), np.float32)
    point = np.empty((knots, 3))
    tangent = np.empty(3)
    view = np.empty(3)
    for s in range(n):
        for k in range(knots):
            for c in range(3):
                point[k, c] = roots[s, c] + unit * (
                    local[s, k, 0] * axes[s, 0, c] + local[s, k, 1] * axes[s, 1, c] + local[s, k, 2] * axes[s, 2, c]
                )
        for k in range(knots):
            before, after = max(k - 1, 0), min(k + 1, knots - 1)
            for c in range(3):
                tangent[c] = point[after, c] - point[before, c]
                view[c] = eye[c] - point[k, c]
            tangent /= np.sqrt((tangent * tangent).sum()) + 1e-20
            view /= np.sqrt((view * view).sum())
            # The ribbon extends across the tangent and the viewing direction.
            bx = tangent[1] * view[2] - tangent[2] * view[1]
            by = tangent[2] * view[0] - tangent[0] * view[2]
            bz = tangent[0] * view[1] - tangent[1] * view[0]
            t = k / (knots - 1)
            half = 0.5 * unit * width[s] * (1.0 - 0.8 * t * t) / (np.sqrt(bx * bx + by * by + bz * bz) + 1e-9)
            row = 2 * (s * knots + k)
            for c in range(3):
                side = half * (bx if c == 0 else (by if c == 1 else bz))
                positions[row, c] = point[k, c] - side
                positions[row + 1, c] = point[k, c] + side
            along = (tangent * key).sum()
            across = np.sqrt(max(1.0 - along * along, 0.0))
            seen = (tangent * view).sum()
            shine = max(across * np.sqrt(max(1.0 - seen * seen, 0.0)) - along * seen, 0.0)
            for c in range(3):
                value = colour[s, c] * (ambient[s, c] + 0.9 * key_colour[c] * across * toward[s])
                value += toward[s] * key_colour[c] * (0.045 * shine**60.0 + 0.22 * colour[s, c] * shine**14.0)
                colours[row, c] = shade[s, k] * value
                colours[row + 1, c] = shade[s, k] * value
    return positions, colours
