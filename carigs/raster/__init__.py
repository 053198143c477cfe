"""Triangle rasteriser: which face, where on it, and how deep, at every pixel."""

from carigs.raster.triangles import Fragments, rasterize_mesh

__all__ = ["Fragments", "rasterize_mesh"]
