"""Footage of a person becomes a tracked dataset, and is judged.

- `video.track_video`: all of it, for a person before one static camera
- `footage_tracking`: which frames count, and the solver on their landmarks
- `landmark_tracking`, `objective`, `priors`, `start`, `visibility`: the solver
- `cameras.Cameras`: focal lengths and poses that are estimated
- `personal_expressions`, `surface_fields`: what one person's head has of its own
- `neck_cut`, `dataset`: mattes that end at the neck, and the dataset
- `quality.TrackedFrames`: what is known of the frames; `coverage`: from which sides they show the head
- `advice`: what to record otherwise, in sentences; `error_table`, `contact_sheet`: errors, and frames with the mesh
"""
