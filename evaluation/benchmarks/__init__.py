"""Benchmarks: time and accuracy of the parts of carigs, as tidy records.

Programs, each with a CSV file and a plot (`make bench` runs all):

- `surface`: the exaggeration; its parts are `surface_solvers` (linear solvers) and `surface_accuracy` (errors)
- `target`: GT* targets over the options of the warp
- `splat`: the surfel engine beside its scalar reference and torch; `training_speed`: whole training steps
- `quality`: PSNR against seconds of training
- `metric_cost`: metrics that need networks (no plot)

Shared parts:

- `timing`, `kernel_timing`: records, times of functions and of the rasterizer's kernels
- `synthetic_scenes`, `surfel_pixel_pairs`: what is rendered, and the number of contributing surfel-pixel pairs
- `plots`: the plots
"""
