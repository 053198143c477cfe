"""Curvature-weighted exaggeration of triangle meshes, on plain arrays: (V, 3) vertices and (F, 3) faces.

- `Exaggerator`: factorise once, solve any level, of the head or (`LocalEdit`) of one region while the rest is held
- `GammaPath`, `straight_path`: S_gamma at any level, interpolated between exact nodes
- `RegionPaths`: independent sliders for regions, which add up without a solve
- `with_blendshapes`: expressions and pose correctives carried along; `Caricature`: all that a level changes of a head
- `blend_bound`: error of the paper's linear blend, and its bound
"""

from carigs.exaggeration.blendshape_transfer import with_blendshapes
from carigs.exaggeration.caricature import Caricature
from carigs.exaggeration.exaggerator import Exaggerator
from carigs.exaggeration.gamma_path import GammaPath, RegionPaths, straight_path
from carigs.exaggeration.local_edit import LocalEdit

__all__ = [
    "Caricature",
    "Exaggerator",
    "GammaPath",
    "LocalEdit",
    "RegionPaths",
    "straight_path",
    "with_blendshapes",
]
