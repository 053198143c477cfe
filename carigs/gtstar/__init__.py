"""GT*: pseudo ground truth, made by warping each frame to its caricature, with a validity mask.

- `warp_frame`: the local affine (paper, equation 5) or perspective warp of one frame
- `make_target` -> `Target`: warped colours and a bit field of `MaskFlag` per pixel
- `face_mask_flags`: flags that hold for a triangle in every frame; its surfels are frozen while a target supervises
- `provide_targets`: the targets of one timestep, by the warp or from edited frames
- `make_target_set`: the targets of all training frames on disk
"""

from carigs.gtstar.mask_flags import MaskFlag, face_mask_flags, flags_from_names
from carigs.gtstar.provider import provide_targets
from carigs.gtstar.target import Target, make_target
from carigs.gtstar.target_set import make_target_set
from carigs.gtstar.warp import Warp, warp_frame

__all__ = [
    "MaskFlag",
    "Target",
    "Warp",
    "face_mask_flags",
    "flags_from_names",
    "make_target",
    "make_target_set",
    "provide_targets",
    "warp_frame",
]
