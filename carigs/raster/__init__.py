"""Triangle rasteriser: which face, where on it, and how deep, at every pixel."""

from carigs.raster.triangles import Fragments, Visibility, project, rasterize_mesh, visible

__all__ = ["Fragments", "Visibility", "project", "rasterize_mesh", "visible"]
