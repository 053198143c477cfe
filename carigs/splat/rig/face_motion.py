"""Motion of every triangle from the canonical to a posed mesh, stored as one record of 32 numbers per triangle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64
from torch import Tensor

STRETCH, CENTRE, ROTATION, RELATIVE_ROTATION, RECORD_SIZE = 0, 6, 9, 18, 32
"""First columns of the fields of a record (6, 3, 9 and 9 numbers), and the size with padding.

Vector kernels read a record as two halves of 16 numbers.
"""
SYMMETRIC = (0, 1, 2, 1, 3, 4, 2, 4, 5)
"""Row-major 3x3 matrix from the numbers xx, xy, xz, yy, yz, zz of a symmetric matrix."""


class FaceMotion(NamedTuple):
    """Jacobian J = U P of every triangle in its polar decomposition, and the rotations of the neighbours relative to U.

    Attributes:
        records: One record per triangle: stretch, centre, rotation, relative rotation, padding. A tensor where
            gradients with respect to the mesh are needed (`mesh_gradient.differentiable_face_motion`).
    """

    records: Float32[np.ndarray, "f 32"] | Float32[Tensor, "f 32"]

    @property
    def stretch(self) -> Float32[np.ndarray, "f 6"]:
        """Stretch P, symmetric: xx, xy, xz, yy, yz, zz."""
        return self.records[:, STRETCH:CENTRE]

    @property
    def centre(self) -> Float32[np.ndarray, "f 3"]:
        """Translation T: mean of the posed corners in metres."""
        return self.records[:, CENTRE:ROTATION]

    @property
    def rotation(self) -> Float32[np.ndarray, "f 3 3"]:
        """Rotation U."""
        return self.records[:, ROTATION:RELATIVE_ROTATION].reshape(-1, 3, 3)

    @property
    def relative_rotation(self) -> Float32[np.ndarray, "f 3 3"]:
        """Rotation vectors log(U^T U_neighbour) in radians, one row per neighbour."""
        return self.records[:, RELATIVE_ROTATION : RELATIVE_ROTATION + 9].reshape(-1, 3, 3)

    @property
    def jacobian(self) -> Float64[np.ndarray, "f 3 3"]:
        """Jacobian J = U P, posed from canonical."""
        stretch = self.stretch.astype(np.float64)[:, SYMMETRIC].reshape(-1, 3, 3)
        return self.rotation.astype(np.float64) @ stretch
