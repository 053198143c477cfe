"""Below, above and beyond what a surfel is not drawn: the same numbers for every backend."""

NEAR = 0.01
"""Metres: surfels whose centre is nearer are left out (as gsplat)."""
THRESHOLD = 1.0 / 255.0
"""Alphas below this are left out (as gsplat)."""
HORIZON = -1e-4
"""rho^2 (p^2 + q^2) - 1 above this: the visible ellipse reaches the camera plane, the surfel is left out."""
SMALLEST_AREA = 1e-24
"""Square metres: tangents with a smaller |u x v| have no normal."""
END = 1e-4
"""A pixel ends before its transmittance falls to this (as gsplat)."""
