"""Rigged Gaussian surfels: parameters, rig, rasteriser, losses, density control, training, files.

- `rig`: canonical frames of the triangles, their Jacobians to a posed mesh, polar parts of those
- `surfels`: what is learned, and which attributes there are
- `skinning`: local -> world by Jacobian blend skinning, with its gradient; its formulas: `jacobian_blend`, `matrix3`
- `appearance`: the colour that each shows, along a view and in a light; its functions: `harmonics`
- `initialise`: the first surfels, coloured from the frames
- `motion`: posed meshes per timestep and level, remembered
- `rasterize`: surfels to images: `projection`, `binning`, `forward`, `backward`, and their vector twins `*_simd`
- `simd`, `simd_math`, `simd_memory`: vectors as Numba values
- `losses`, `ssim`: images to a loss
- `regularisers`: terms on the surfels themselves and on the rendered geometry
- `adam`, `density`: updates; cloning, splitting and pruning within a budget
- `supervision`, `image_cache`: which frame or target supervises which step, decoded ahead
- `trainer`, `checkpoint`: the loop, and how it goes on after a kill
- `avatar`, `ply`: files

Nothing is imported here: some of these modules need torch, which takes seconds to load, others do not.
"""
