"""The learned surfel attributes, their initialization and their files.

- `surfels`: the attributes (`Surfels`) and their conversion from and to arrays
- `initialization`: initial surfels on a mesh, coloured from the training images
- `ply`: .ply files in the layouts of SurFhead and GaussianAvatars

Modules are imported directly: this package imports nothing, so that no module loads more than it needs.
"""
