"""Triangle meshes on plain arrays: repair, validation, curvature, the cotan Laplacian and linear solvers.

- `clean_mesh`: repair an input mesh and map results back to it
- `check_mesh`: raise a typed error for a mesh that cannot be used
- `CotanLaplacian`: the discrete Laplace-Beltrami operator
- `vertex_normals`, `smoothstep`: used by several rooms
- `carigs.mesh.carried_points`: points beside a mesh, carried by its triangles
- `carigs.mesh.curvature`: Gaussian curvature
- `carigs.mesh.linear_solver`: factorised systems, and the Poisson equation
- `carigs.mesh.regions`: named parts of a surface as smooth fields
- `carigs.mesh.rigid_alignment`: the rigid motion between two sets of points
"""

from carigs.mesh.cotan_laplacian import CotanLaplacian
from carigs.mesh.repair import CleanMesh, clean_mesh
from carigs.mesh.smoothstep import smoothstep
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.mesh.validation import check_mesh

__all__ = ["CleanMesh", "CotanLaplacian", "check_mesh", "clean_mesh", "smoothstep", "vertex_normals"]
