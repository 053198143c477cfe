"""The training step in plain PyTorch, for any device: a twin of each Numba kernel of the step.

- `step`: `DeviceStep`, the step; `device`: which device a backend uses
- `skinning`, `colour`: surfels to world coordinates and colours; `mesh`: what they need to know of the rig
- `photometric_loss`, `threshold_loss`: the losses
- `adam`: `DeviceAdam` with frozen rows; `statistics`: gradients for density control; `hair_rules`: rules for hair
- `placement`: surfels and training states between the host and the device
- `examples`: images and motions, copied to the device ahead of their use

The rasterizers are `rasterizer.torch_rasterizer` and `rasterizer.cuda`. Density control itself stays on the host: it
runs once in hundreds of steps, and draws the same random numbers for all backends.
"""
