"""Strands in an image: ribbons that face the eye, lit as hair is."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Float32, Int32

from carigs.toy.look.hair import Strands
from carigs.toy.look.lighting import KEY_COLOUR, Light


def ribbon_faces(strands: int, knots: int, first: int) -> Int32[np.ndarray, "f 3"]:
    """Two triangles between neighbouring knots; vertices are numbered from `first`, two to a knot."""
    row = first + 2 * (np.arange(strands)[:, None] * knots + np.arange(knots - 1)).reshape(-1)
    return np.concatenate(
        [np.stack([row, row + 1, row + 2], axis=1), np.stack([row + 1, row + 3, row + 2], axis=1)]
    ).astype(np.int32)


def comb(
    strands: Strands,
    colour: Float[np.ndarray, "s 3"],
    roots: Float[np.ndarray, "s 3"],
    axes: Float[np.ndarray, "s 3 3"],
    unit: float,
    eye: Float[np.ndarray, "3"],
    light: Light,
) -> tuple[Float[np.ndarray, "r 3"], Float32[np.ndarray, "r 3"]]:
    """Vertices (metres) and lit linear colours of the ribbons as `eye` sees them.

    `roots` and the rows of `axes` are where each root and its triangle's frame lie now, `colour` is linear, `unit` the
    metres of a strand's length unit.  Highlights after Kajiya and Kay (1989).
    """
    normals = np.ascontiguousarray(axes[:, 2])
    toward = np.maximum(0.35 + 0.65 * (normals @ light.key), 0.0)
    count = 2 * strands.local.shape[0] * strands.local.shape[1]
    positions, colours = np.empty((count, 3)), np.empty((count, 3), np.float32)
    _comb(
        strands.local, strands.width, strands.shade, colour, roots, axes, unit, eye, light.key, KEY_COLOUR, toward,
        light.ambient(normals), positions, colours,
    )  # fmt: skip
    return positions, colours


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _comb(local, width, shade, colour, roots, axes, unit, eye, key, key_colour, toward, ambient, positions, colours):
    knots = local.shape[1]
    point = np.empty((knots, 3))
    tangent = np.empty(3)
    view = np.empty(3)
    for s in range(len(roots)):
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
