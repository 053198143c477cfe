"""Layout of the arrays that the rasterizer's kernels exchange, and the thresholds that all backends share.

Both are compile-time constants, see `carigs.simd.kernels`.

Symbols are those of `projection`, where the quantities are computed.

A **record** describes one projected surfel. Its columns are the fields of `SurfelRecord`, in order:

=======  =======================  ======================================================================================
columns  fields                   content
=======  =======================  ======================================================================================
0-1      dx, dy                   first pixel centre of the surfel's box minus the projected centre, in pixels
2-5      u0, u1, v0, v1           homography from disc coordinates to pixel offsets
6-8      det, a3, b3              denominator of the inverse homography: zz = det + a3 dx + b3 dy
9        log2_opacity             log2 of the opacity
10-12    red, green, blue         colour minus the background
13       depth                    depth Z of the centre in metres
14-16    normal_x .. normal_z     unit normal in camera axes
=======  =======================  ======================================================================================

A **gradient slot** holds the derivatives of the loss that one (surfel, tile) pair contributes, summed over the tile's
pixels. Its columns are the fields of `GradientSlot`, in order; zx, zy, zz are the homogeneous disc coordinates of a
pixel's ray, and (dx, dy) is the pixel's offset from the projected centre:

=======  =======================  ======================================================================================
columns  fields                   content
=======  =======================  ======================================================================================
0-2      zx, zy, zz               sum dL/dzx, sum dL/dzy, sum dL/dzz
3-4      zx_dx, zx_dy             sum dL/dzx dx, sum dL/dzx dy
5-6      zy_dx, zy_dy             sum dL/dzy dx, sum dL/dzy dy
7-8      zz_dx, zz_dy             sum dL/dzz dx, sum dL/dzz dy
9        log_opacity              derivative with respect to ln(opacity)
10-12    red, green, blue         derivative with respect to the colour
13       depth                    derivative with respect to the depth
14-16    normal_x .. normal_z     derivative with respect to the normal
=======  =======================  ======================================================================================

An **image** consists of planes, numbered by `PLANE`: the transmittance T, the colour, depth and normal, the distortion.
Planes that nobody asks for are left out from the end. In the gradient of an image the first plane is the derivative
with respect to alpha = 1 - T.
"""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32

SurfelRecord = namedtuple(
    "SurfelRecord",
    "dx dy u0 u1 v0 v1 det a3 b3 log2_opacity red green blue depth normal_x normal_y normal_z",
)
GradientSlot = namedtuple(
    "GradientSlot",
    "zx zy zz zx_dx zx_dy zy_dx zy_dy zz_dx zz_dy log_opacity red green blue depth normal_x normal_y normal_z",
)
RECORD_COLUMN, GRADIENT_COLUMN = SurfelRecord(*range(17)), GradientSlot(*range(17))
"""Number of the column of each field."""
RECORD_SIZE = GRADIENT_SIZE = 17
"""A row is two overlapping vectors of 16."""
Planes = namedtuple("Planes", "transmittance red green blue depth normal_x normal_y normal_z distortion")
PLANE = Planes(*range(9))
NUM_COLOUR_PLANES, NUM_GEOMETRY_PLANES, NUM_PLANES = PLANE.depth, PLANE.distortion, len(PLANE)
"""Planes of an image of colours; with depth and normal; with the distortion, too."""

NEAR_PLANE = 0.01
"""Metres. Surfels with a centre nearer to the camera are culled (as in gsplat)."""
ALPHA_THRESHOLD = 1.0 / 255.0
"""Contributions with a smaller alpha are dropped (as in gsplat)."""
CAMERA_PLANE_MARGIN = -1e-4
"""Surfels with r^2 (p^2 + q^2) - 1 above this value are culled: the visible ellipse reaches the camera plane."""
MIN_AREA = 1e-24
"""Square metres. Surfels with a smaller |tangent_u x tangent_v| are culled: they have no normal."""
MAX_SQUARED_LENGTH = 1e18
"""Surfels are culled whose centre and tangents have a larger sum of squares, in square metres: their determinants and
gradients would overflow in float32."""
TRANSMITTANCE_THRESHOLD = 1e-4
"""A pixel is complete before its transmittance would fall to this value (as in gsplat)."""


class SurfelArrays(NamedTuple):
    """World-space surfels as contiguous float32 arrays (see `WorldSurfels`). Vector kernels take flattened arrays."""

    centre: Float32[np.ndarray, "n 3"]
    tangent_u: Float32[np.ndarray, "n 3"]
    tangent_v: Float32[np.ndarray, "n 3"]
    opacity: Float32[np.ndarray, " n"]
    colour: Float32[np.ndarray, "n 3"]


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
    opacity: Float32[np.ndarray, " n"]
    colour: Float32[np.ndarray, "n 3"]
    projected_centre: Float32[np.ndarray, "n 2"]
    """With respect to the projected centre in pixels."""


class ProjectedSurfels(NamedTuple):
    """Surfels in image space: the input of binning and compositing. Vector kernels take flattened arrays."""

    record: Float32[np.ndarray, "n 17"]
    """See the table of the module; undefined for culled surfels."""
    box: Int32[np.ndarray, "n 4"]
    """Pixel box [x0, x1, y0, y1) that contains all alphas of 1/255 or more; zeros for culled surfels."""
    num_tiles: Int32[np.ndarray, " n"]
    """Tiles that the box overlaps; 0 for culled surfels."""


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
