"""Frames edited while an avatar is trained on them: the loop, what edits an image, and where edits are allowed.

- `dataset_update`: which frame is edited when, and the frames that edits have replaced
- `edit_steps`: the steps of a training before which a frame is edited
- `view`, `editor`: what an editor gets and returns; the editors by their names
- `instruct_pix2pix`, `controlnet_ip2p`: diffusion models, by the sampler of `guided_sampling`
- `exemplar`: images in the style of one image, for GT* frames; `square_images`
- `drawn_nose`: an editor without networks, whose inconsistency between views is known
- `region_mask`: pixels and triangles to which edits are confined
"""
