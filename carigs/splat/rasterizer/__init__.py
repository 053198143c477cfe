"""The differentiable rasterizer of 2D Gaussian surfels, with CPU, PyTorch and CUDA backends.

- `rasterize`: the function `rasterize`, an autograd function with backends
- `interface`: its inputs and outputs, `WorldSurfels` and `Rendering`
- `projection`: surfels to homographies and pixel boxes, and back (formulas and scalar loops)
- `binning`: depth-sorted lists of surfels per tile
- `forward`, `backward`: compositing and its gradient in scalar loops, the readable reference
- `projection_simd`, `forward_simd`, `backward_simd`: the same, sixteen surfels or pixels at a time
- `tile_buffer`, `surfel_blocks`: the pixels of a tile and the surfels that overlap it, for these kernels
- `records`: layout of the kernels' arrays, and the thresholds of culling
- `torch_rasterizer`: the backend in plain PyTorch, for any device; `torch_projection`, `torch_lists`,
  `torch_compositing`: its parts
- `cuda`: the backend on gsplat's kernels

Modules are imported directly: a name here would hide the module `rasterize`.
"""
