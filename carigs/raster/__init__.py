"""Triangle rasterizer: which face is visible at every pixel, where on it, and at what depth.

- `compute_visibility` -> `Visibility`: the nearest face and inverse depth at every pixel of a camera
- `rasterize_mesh` -> `Fragments`: barycentric coordinates and depth as well
- `visible_vertices`, `sample_colours`: the colours of an image at the vertices that it shows
- `BitMask`: image masks packed into bits
"""

from carigs.raster.bit_masks import BitMask
from carigs.raster.rasterizer import Fragments, Visibility, compute_visibility, rasterize_mesh
from carigs.raster.vertex_colours import VisibleVertices, sample_colours, visible_vertices

__all__ = [
    "BitMask",
    "Fragments",
    "Visibility",
    "VisibleVertices",
    "compute_visibility",
    "rasterize_mesh",
    "sample_colours",
    "visible_vertices",
]
