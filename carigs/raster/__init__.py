"""Triangle rasteriser: which face, where on it, and how deep, at every pixel."""

from carigs.raster.triangles import Fragments, Visibility, rasterize_mesh, visible

__all__ = ["Fragments", "Visibility", "rasterize_mesh", "visible"]
