"""Benchmarks: time and accuracy of the parts of carigs, as tidy records.

Programs, each with a CSV file and a plot (`make bench` runs all):

- `surface`: the exaggeration; its parts are `surface_solvers` (linear solvers), `curvature_accuracy` (estimators of
  curvature) and `surface_accuracy` (other errors)
- `target`: GT* targets over the options of the warp; `relighting`: over the directions of the fitted light
- `trusted_pixels`: error of the pixels that GT* frames trust, for a subject of a study (no plot)
- `training_trade_offs`: time and PSNR of trainings on the toy over settings and presets (no plot); `toy_training`:
  one training and its PSNR
- `splat`: the surfel engine beside its scalar reference and torch; `training_speed`: whole training steps
- `refined_step`: a training step that refines the tracking beside one that does not (no plot)
- `quality`: PSNR against seconds of training
- `image_metric_cost`: metrics of rendered images that need no network
- `metric_cost`: metrics that need networks (no plot)
- `gpu`: what a GPU does, in parts (`make gpu`, no plot)

Shared parts:

- `timing`, `kernel_timing`: records, times of functions and of the rasterizer's kernels
- `synthetic_scenes`, `surfel_pixel_pairs`: what is rendered, and the number of contributing surfel-pixel pairs
- `toy_frames`: frames of the procedural subject with their true caricatures
- `plots`: the plots

`evaluation.trade_offs` makes the page docs/benchmarks.md of the records.
"""
