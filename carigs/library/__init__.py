"""The library: what scripts and notebooks call.

- `load` -> `HeadAvatar` -> `PosedHead`: pose, exaggerate and render a trained avatar
- `orbit`: cameras around a head
- `exaggerate`: the caricature of a mesh
"""

from carigs.library.any_mesh import exaggerate
from carigs.library.head_avatar import HeadAvatar, load
from carigs.library.orbit_cameras import orbit
from carigs.library.posed_head import PosedHead

__all__ = ["HeadAvatar", "PosedHead", "exaggerate", "load", "orbit"]
