"""GT*: pseudo ground truth by warping a frame to its caricature, with reasons against doubtful pixels.

- `make_target`: one frame, two meshes, one camera -> `Target`: colours and a bit field of `MaskFlag`
- `face_mask_flags`: the triangles that a reason always holds for; their surfels are frozen while a target supervises
"""

from carigs.gtstar.mask_flags import MaskFlag, face_mask_flags, flags_from_names
from carigs.gtstar.target import Target, make_target
from carigs.gtstar.warp import Warp, warp_frame

__all__ = ["MaskFlag", "Target", "Warp", "face_mask_flags", "flags_from_names", "make_target", "warp_frame"]
