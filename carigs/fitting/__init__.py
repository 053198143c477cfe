"""Fit of a head model to calibrated video with landmarks: shape, and expression and pose per frame.

- `fit_video`: all of it; `carigs fit` writes its result as a dataset
- `landmark_fit.fit_landmarks`: triangulation, rigid alignment, reprojection error
- `refinement.Refinement`: outlines against mattes, photometric agreement
- `levenberg_marquardt.minimise`, `objective`, `normal_equations`: the solver
- `footage`, `landmark_files`, `landmark_providers`: files
"""

from carigs.fitting.video_fit import VideoFit, fit_video

__all__ = ["VideoFit", "fit_video"]
