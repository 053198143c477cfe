"""GT*: pseudo ground truth by warping a frame to its caricature, and masks that say which pixels to trust.

- `warp_frame`: one frame, two meshes, one camera -> `Warp` (colours and where they came from)
- `validity`: which pixels of a `Warp` may supervise training
- `frozen_faces`: the triangles whose surfels are frozen while a target supervises
"""

from carigs.target.masks import Validity, frozen_faces, validity
from carigs.target.warp import Warp, warp_frame

__all__ = ["Validity", "Warp", "frozen_faces", "validity", "warp_frame"]
