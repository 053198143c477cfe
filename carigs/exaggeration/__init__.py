"""Curvature-weighted exaggeration of triangle meshes, on plain arrays: (V, 3) vertices and (F, 3) faces.

- `Exaggerator`: factorise once, then solve any level, of the head or of one region with the rest held
- `GammaPath`, `straight_path`: S_gamma at any level, interpolated between exactly solved nodes
- `Caricature`: the change of a head and of its blendshapes at one level
- `RegionPaths`: independent sliders for regions
- `transfer_blendshapes`: expressions and pose correctives of the caricature
- `carigs.exaggeration.weighted_poisson`: the equation that is solved (paper, equations 1 to 3)
- `carigs.exaggeration.local_edit`: the equation of one region (paper, equation 4)
- `carigs.exaggeration.blend_bound`: error of the paper's linear blend and its upper bounds
"""

from carigs.exaggeration.blendshape_transfer import transfer_blendshapes
from carigs.exaggeration.exaggerator import Exaggerator
from carigs.exaggeration.gamma_path import Caricature, GammaPath, straight_path
from carigs.exaggeration.region_paths import RegionPaths

__all__ = ["Caricature", "Exaggerator", "GammaPath", "RegionPaths", "straight_path", "transfer_blendshapes"]
