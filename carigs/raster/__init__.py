"""Triangle rasterizer: which face is visible at every pixel, where on it, and at what depth.

- `compute_visibility` -> `Visibility`: the nearest face and inverse depth at every pixel of a camera
- `rasterize_mesh` -> `Fragments`: barycentric coordinates and depth as well
- `vertex_colours`: the colours of an image at the vertices that it shows
- `bit_masks.BitMask`: image masks packed into bits
"""

from carigs.raster.rasterizer import Fragments, Visibility, compute_visibility, rasterize_mesh

__all__ = ["Fragments", "Visibility", "compute_visibility", "rasterize_mesh"]
