"""Curvature-weighted exaggeration of triangle meshes, on plain arrays: (V, 3) vertices and (F, 3) faces.

- `Exaggerator`: factorise once, solve any level, of the head or (`LocalEdit`) of one region while the rest is held
- `GammaPath`, `straight_path`: S_gamma at any level, interpolated between exact nodes
- `RegionPaths`: independent sliders for regions, which add up without a solve
- `with_motions`: expressions and pose correctives carried along; `Caricature`: all that a level changes of a head
- `clean_mesh`: meshes from anywhere, mended; `check_mesh`: typed errors for those that cannot be used
- `carigs.surface.curvature`, `operators`, `occlusion`, `followers`: what the solve is made of
- `python -m carigs.surface head.obj -o out.ply`: all of it for a file; its picture: `evaluation.clay`
- `carigs.surface.bound`: error of the paper's linear blend, and what bounds it
"""

from carigs.surface.caricature import Caricature
from carigs.surface.cleaning import CleanMesh, MeshReport, clean_mesh
from carigs.surface.exaggeration import Exaggerator
from carigs.surface.local import LocalEdit
from carigs.surface.mesh import check_mesh
from carigs.surface.path import GammaPath, RegionPaths, straight_path
from carigs.surface.transport import with_motions

__all__ = [
    "Caricature",
    "CleanMesh",
    "Exaggerator",
    "GammaPath",
    "LocalEdit",
    "MeshReport",
    "RegionPaths",
    "check_mesh",
    "clean_mesh",
    "straight_path",
    "with_motions",
]
