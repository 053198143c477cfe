"""The motion of every triangle, one row of numbers each, and how the kernels read it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np
from jaxtyping import Float32

if TYPE_CHECKING:
    from torch import Tensor

# Columns of a face's row in `FaceMotion`; kernels read it as two halves of 16.
STRETCH, CENTRE, ROTATION, TURN, MOTION_ROW = 0, 6, 9, 18, 32


class FaceMotion(NamedTuple):
    """Motion of every triangle from the canonical to a posed mesh: J = U P, and the neighbours' U relative to it."""

    rows: Float32[np.ndarray, "f 32"] | Float32[Tensor, "f 32"]
    """All of a triangle in one row, for the kernels: `stretch`, `centre`, `rotation`, `turn`, spare numbers.

    A tensor where the mesh is being fine-tuned (`mesh_gradient.tuned_motion`).
    """

    @property
    def stretch(self) -> Float32[np.ndarray, "f 6"]:
        """P, symmetric: xx, xy, xz, yy, yz, zz."""
        return self.rows[:, STRETCH:CENTRE]

    @property
    def centre(self) -> Float32[np.ndarray, "f 3"]:
        """T: mean of the posed corners in metres."""
        return self.rows[:, CENTRE:ROTATION]

    @property
    def rotation(self) -> Float32[np.ndarray, "f 3 3"]:
        """U."""
        return self.rows[:, ROTATION:TURN].reshape(-1, 3, 3)

    @property
    def turn(self) -> Float32[np.ndarray, "f 3 3"]:
        """Rotation vectors log(U^T U_neighbour) in radians, one row per neighbour."""
        return self.rows[:, TURN : TURN + 9].reshape(-1, 3, 3)


@numba.njit(cache=True)
def read_face(f, neighbours, rows):
    """Stretches of the face and its neighbours, the neighbours' turns, rotation and centre of the face."""
    i, j, k = neighbours[f, 0], neighbours[f, 1], neighbours[f, 2]
    return (
        read6(rows, f), read6(rows, i), read6(rows, j), read6(rows, k), read9(rows, f, TURN),
        read9(rows, f, ROTATION), (rows[f, CENTRE], rows[f, CENTRE + 1], rows[f, CENTRE + 2]),
    )  # fmt: skip


@numba.njit(cache=True)
def read3(rows, i):
    """The first numbers of a row."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@numba.njit(cache=True)
def read4(rows, i):
    """The first numbers of a row."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@numba.njit(cache=True)
def read6(rows, f):
    """The stretch of a face."""
    r = rows[f, STRETCH : STRETCH + 6]
    return r[0], r[1], r[2], r[3], r[4], r[5]


@numba.njit(cache=True)
def read9(rows, f, at):
    """Nine numbers of a row, from `at` on."""
    r = rows[f, at : at + 9]
    return r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]
