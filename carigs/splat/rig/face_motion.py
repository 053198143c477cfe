"""The motion of every triangle, one row of numbers each, and how the kernels read it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float32

from carigs.simd import matrix3
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig.jacobian_blend import blended_motion, shares_of

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


@scalar_or_simd
def read_face(f, neighbours, rows):
    """Stretches of the face and its neighbours, the neighbours' turns, rotation and centre of the face."""
    i, j, k = neighbours[f, 0], neighbours[f, 1], neighbours[f, 2]
    return (
        read6(rows, f), read6(rows, i), read6(rows, j), read6(rows, k), read9(rows, f, TURN),
        read9(rows, f, ROTATION), (rows[f, CENTRE], rows[f, CENTRE + 1], rows[f, CENTRE + 2]),
    )  # fmt: skip


@scalar_or_simd
def read_blend(i, blend, binding, neighbours, rows, blended):
    """The faces around surfel i, the centre of its own, and how it blends their motions.

    Returns stretches and turns as `jacobian_blend` takes them, the centre, sigmoids of the weights and their inverse
    sum, the weights, and of the blend: rotation vector, stretch, terms of the exponential, rotation.
    """
    own, one, two, three, turn, u, t = read_face(binding[i], neighbours, rows)
    shares, g = (1.0, 0.0, 0.0, 0.0), 1.0
    if blended:
        shares, g = shares_of(read4(blend, i))
    v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
    w, p = blended_motion(v, own, one, two, three, turn)
    terms = matrix3.rodrigues_coefficients(w)
    q = matrix3.product_exp(u, w, terms[0], terms[1])
    return (own, one, two, three, turn), t, shares, g, v, w, p, terms, q


@scalar_or_simd
def read3(rows, i):
    """The first numbers of a row."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@scalar_or_simd
def read4(rows, i):
    """The first numbers of a row."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@scalar_or_simd
def read6(rows, f):
    """The stretch of a face."""
    r = rows[f, STRETCH : STRETCH + 6]
    return r[0], r[1], r[2], r[3], r[4], r[5]


@scalar_or_simd
def read9(rows, f, at):
    """Nine numbers of a row, from `at` on."""
    r = rows[f, at : at + 9]
    return r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]
