"""Rigged Gaussian surfels: what the avatar consists of, how it is rendered and how it is trained.

- `surfels`: the learned attributes, their initialization and .ply files
- `rig`: motion of the triangles, Jacobian blend skinning (local to world), posed meshes per timestep and level
- `colour`: view-dependent colour in a light
- `rasterizer`: surfels to images, differentiably
- `training`: losses, regularizers, optimizer, density control, supervision, the training loop and its checkpoints
- `render`: surfels on a posed mesh to an image
- `avatar`: files of trained avatars

Nothing is imported here: some of these modules need torch, which takes seconds to load, others do not.
"""
