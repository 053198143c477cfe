"""GT*: pseudo ground truth, made by warping each frame to its caricature, with a validity mask.

- `warp_frame`: the local affine (paper, equation 5) or perspective warp of one frame
- `make_target` -> `Target`: warped colours and a bit field of `MaskFlag` per pixel
- `face_mask_flags`: flags that hold for a triangle in every frame; its surfels are frozen while a target supervises
- `provider.provide_targets`: the targets of one timestep, by the warp or from edited frames
- `target_set.make_target_set`: the targets of all training frames on disk
"""

from carigs.gtstar.mask_flags import MaskFlag, face_mask_flags, flags_from_names
from carigs.gtstar.target import Target, make_target
from carigs.gtstar.warp import warp_frame

__all__ = ["MaskFlag", "Target", "face_mask_flags", "flags_from_names", "make_target", "warp_frame"]
