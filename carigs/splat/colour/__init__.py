"""The colour of a surfel along a view direction: spherical harmonics and light.

- `appearance`: `seen_colour`, differentiable, with its scalar kernels
- `appearance_simd`: the kernels for sixteen surfels at a time
- `spherical_harmonics`: the basis functions and their derivatives

Modules are imported directly: this package imports nothing, so that no module loads more than it needs.
"""
