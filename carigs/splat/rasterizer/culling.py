"""Culling and termination thresholds shared by all backends (compile-time constants, see `carigs.simd.kernels`)."""

NEAR_PLANE = 0.01
"""Metres. Surfels with a centre nearer to the camera are culled (as in gsplat)."""
ALPHA_THRESHOLD = 1.0 / 255.0
"""Contributions with a smaller alpha are dropped (as in gsplat)."""
CAMERA_PLANE_MARGIN = -1e-4
"""Surfels with r^2 (p^2 + q^2) - 1 above this value are culled: the visible ellipse reaches the camera plane."""
MIN_AREA = 1e-24
"""Square metres. Surfels with a smaller |tangent_u x tangent_v| are culled: they have no normal."""
TRANSMITTANCE_THRESHOLD = 1e-4
"""A pixel is complete before its transmittance would fall to this value (as in gsplat)."""
