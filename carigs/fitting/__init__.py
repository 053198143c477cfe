"""Fit of a head model to calibrated video with landmarks: shape, and expression and pose per frame.

- `fit_video`: all of it; `carigs fit` writes its result as a dataset
- `landmarks`: their files, what a detector's numbers mean, and the fit of a head to them
- `refinement.Refinement`: outlines against mattes, photometric agreement
- `levenberg_marquardt.minimise`, `objective`, `normal_equations`: the solver
- `footage`: images of a capture without parameters
"""

from carigs.fitting.video_fit import VideoFit, fit_video

__all__ = ["VideoFit", "fit_video"]
