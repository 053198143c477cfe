"""Triangle meshes on plain arrays: repair, validation, curvature, the cotan Laplacian and linear solvers.

- `clean_mesh`: repair an input mesh and map results back to it
- `check_mesh`: raise a typed error for a mesh that cannot be used
"""

from carigs.mesh.repair import CleanMesh, MeshReport, clean_mesh
from carigs.mesh.triangle_mesh import check_mesh

__all__ = ["CleanMesh", "MeshReport", "check_mesh", "clean_mesh"]
