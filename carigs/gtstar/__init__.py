"""GT*: pseudo ground truth by warping a frame to its caricature, with reasons against doubtful pixels.

- `make_target`: one frame, two meshes, one camera -> `Target`: colours and a bit field of `Reason`
- `face_reasons`: the triangles that a reason always holds for; their surfels are frozen while a target supervises
"""

from carigs.gtstar.mask_flags import Reason, as_bits, face_reasons
from carigs.gtstar.target import Target, make_target
from carigs.gtstar.warp import Warp, warp_frame

__all__ = ["Reason", "Target", "Warp", "as_bits", "face_reasons", "make_target", "warp_frame"]
