"""Footage of a person becomes a tracked dataset, and is judged.

- `video.track_video`: all of it, for one camera or several, an orbit, or photographs of one moment
- `sources`, `kinds`: which files are recordings, their frames in step, and what kind of footage they are
- `recording.Recording`: what one camera recorded, with landmarks and measures
- `takes`: which frames count; `footage_tracking`: the head in them
- `solver`: the solver; `start`, `visibility`: its first guess, and which landmarks count in which camera
- `cameras.Cameras`: focal lengths and poses that are estimated; `camera_placement`: where they stand to each other;
  `world`: the world of a dataset
- `surface_fields`, `own_blendshapes`: smooth fields on a head, and blendshapes that one person's head has of its own
- `torso`: how shoulders and chest move, and the bend of the neck between them and the head
- `dataset`: writes the dataset
- `texture`: how the skull moves, by corners in hair and skin
- `outline`, `skin`: what frames show of the head beyond landmarks: its outline, how its skin moves, and where several
  cameras see the same of it
- `judgement`: errors by region, the contact sheet, and what to record otherwise
"""
