"""Layout of the arrays that the rasterizer's kernels exchange.

The column numbers are compile-time constants of the kernels (see `carigs.simd.kernels`). Symbols are those of
`projection`, where the quantities are computed.

A **record** describes one projected surfel:

=======  =============================  ==============================================================================
columns  constant                       content
=======  =============================  ==============================================================================
0-1      RECORD_DX, RECORD_DY           first pixel centre of the surfel's box minus the projected centre, in pixels
2-5      RECORD_U0, U1, V0, V1          homography from disc coordinates to pixel offsets
6-8      RECORD_DET, A3, B3             denominator of the inverse homography: zz = det + a3 dx + b3 dy
9-10     RECORD_LOWPASS_X, _Y           projected centre minus the centre of the low-pass filter, in pixels
11       RECORD_LOG2_OPACITY            log2 of the opacity
12-14    RECORD_RED, GREEN, BLUE        colour minus the background
15       RECORD_DEPTH                   depth Z of the centre in metres
16-18    RECORD_NORMAL_X, _Y, _Z        unit normal in camera axes
19       -                              unused: rows of 20 numbers can be stored as two vectors of 16
=======  =============================  ==============================================================================

A **gradient slot** holds the derivatives of the loss that one (surfel, tile) pair contributes, summed over the tile's
pixels. zx, zy, zz are the homogeneous disc coordinates of a pixel's ray, (dx, dy) is the pixel's offset from the
projected centre:

=======  =============================  ==============================================================================
columns  constant                       content
=======  =============================  ==============================================================================
0-2      GRADIENT_ZX, ZY, ZZ            sum dL/dzx, sum dL/dzy, sum dL/dzz
3-4      GRADIENT_ZX_DX, ZX_DY          sum dL/dzx dx, sum dL/dzx dy
5-6      GRADIENT_ZY_DX, ZY_DY          sum dL/dzy dx, sum dL/dzy dy
7-8      GRADIENT_ZZ_DX, ZZ_DY          sum dL/dzz dx, sum dL/dzz dy
9-10     GRADIENT_LOWPASS_X, _Y         derivative with respect to the offset from the low-pass centre
11       GRADIENT_LOG_OPACITY           derivative with respect to ln(opacity)
12-14    GRADIENT_RED, GREEN, BLUE      derivative with respect to the colour
15       GRADIENT_DEPTH                 derivative with respect to the depth
16-18    GRADIENT_NORMAL_X, _Y, _Z      derivative with respect to the normal
19       -                              unused
=======  =============================  ==============================================================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32

RECORD_SIZE = 20
RECORD_DX, RECORD_DY = 0, 1
RECORD_U0, RECORD_U1, RECORD_V0, RECORD_V1 = 2, 3, 4, 5
RECORD_DET, RECORD_A3, RECORD_B3 = 6, 7, 8
RECORD_LOWPASS_X, RECORD_LOWPASS_Y = 9, 10
RECORD_LOG2_OPACITY = 11
RECORD_RED, RECORD_GREEN, RECORD_BLUE = 12, 13, 14
RECORD_DEPTH = 15
RECORD_NORMAL_X, RECORD_NORMAL_Y, RECORD_NORMAL_Z = 16, 17, 18

GRADIENT_SIZE = 20
GRADIENT_ZX, GRADIENT_ZY, GRADIENT_ZZ = 0, 1, 2
GRADIENT_ZX_DX, GRADIENT_ZX_DY = 3, 4
GRADIENT_ZY_DX, GRADIENT_ZY_DY = 5, 6
GRADIENT_ZZ_DX, GRADIENT_ZZ_DY = 7, 8
GRADIENT_LOWPASS_X, GRADIENT_LOWPASS_Y = 9, 10
GRADIENT_LOG_OPACITY = 11
GRADIENT_RED, GRADIENT_GREEN, GRADIENT_BLUE = 12, 13, 14
GRADIENT_DEPTH = 15
GRADIENT_NORMAL_X, GRADIENT_NORMAL_Y, GRADIENT_NORMAL_Z = 16, 17, 18


class SurfelArrays(NamedTuple):
    """World-space surfels as contiguous float32 arrays (see `WorldSurfels`). Vector kernels take flattened arrays."""

    centre: Float32[np.ndarray, "n 3"]
    tangent_u: Float32[np.ndarray, "n 3"]
    tangent_v: Float32[np.ndarray, "n 3"]
    opacity: Float32[np.ndarray, "n"]
    colour: Float32[np.ndarray, "n 3"]

    def flattened(self) -> SurfelArrays:
        """The same arrays with one dimension.

        Returns:
            Views of the arrays.
        """
        return SurfelArrays(*(array.reshape(-1) for array in self))


class Pinhole(NamedTuple):
    """A camera as Numba arguments."""

    rotation: tuple[float, ...]
    """Upper left 3 x 3 block of camera_from_world, row by row."""
    translation: tuple[float, ...]
    """Last column of camera_from_world, in metres."""
    fx: float
    fy: float
    cx: float
    cy: float
    width: float
    """Pixels, as all that follow the translation."""
    height: float


class SurfelGradients(NamedTuple):
    """Gradients of the loss with respect to the surfels, float32; zeros for culled surfels."""

    centre: Float32[np.ndarray, "n 3"]
    tangent_u: Float32[np.ndarray, "n 3"]
    tangent_v: Float32[np.ndarray, "n 3"]
    opacity: Float32[np.ndarray, "n"]
    colour: Float32[np.ndarray, "n 3"]
    projected_centre: Float32[np.ndarray, "n 2"]
    """With respect to the projected centre in pixels."""


class SurfelRecord(NamedTuple):
    """Columns 2 to 18 of a record as numbers or vectors of equal lanes."""

    u0: float
    u1: float
    v0: float
    v1: float
    det: float
    a3: float
    b3: float
    lowpass_x: float
    lowpass_y: float
    log2_opacity: float
    red: float
    green: float
    blue: float
    depth: float
    normal_x: float
    normal_y: float
    normal_z: float


class ProjectedSurfels(NamedTuple):
    """Surfels in image space: the input of binning and compositing. Vector kernels take flattened arrays."""

    record: Float32[np.ndarray, "n 20"]
    """See the table of the module; undefined for culled surfels."""
    box: Int32[np.ndarray, "n 4"]
    """Pixel box [x0, x1, y0, y1) that contains all alphas of 1/255 or more; zeros for culled surfels."""
    num_tiles: Int32[np.ndarray, "n"]
    """Tiles that the box overlaps; 0 for culled surfels."""

    def flattened(self) -> ProjectedSurfels:
        """The same arrays with one dimension.

        Returns:
            Views of the arrays.
        """
        return ProjectedSurfels(self.record.reshape(-1), self.box.reshape(-1), self.num_tiles)


class Compositing(NamedTuple):
    """Image size and constants of the compositing."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    alpha_cap: np.float32
    """Upper limit of a surfel's alpha."""
    background: np.float32
    """Grey value behind the surfels."""
