"""Training: losses, supervision, optimisation, density control and checkpoints.

- `trainer`: `train_surfels`, the training loop; `learning_rates`
- `subject`: `TrainingSubject`, how the head moves, its images, hair and mouth; `prepare_subject`
- `training_step`: what a step is; `numba_step`: the step on the host; `device`: the same in PyTorch on a device
- `schedule`: `draw_schedule`, the random alternation of real frames and GT* targets
- `supervision`: `Supervision`, the training examples and their masks; `image_cache`: images decoded ahead
- `photometric_loss`: L1 and SSIM; `ssim`: its kernel; `regularizers`: threshold losses, normal consistency
- `adam`: `Adam` with freezing of rows; `density`: cloning, splitting and pruning
- `tracking_refinement`: `TrackingRefinement`, head parameters that are optimised with the surfels
- `initial_surfels`: surfels on triangles, inside the hair, inside the mouth
- `checkpoint`: `TrainingState` on disk; `progress`: progress on stderr
"""
