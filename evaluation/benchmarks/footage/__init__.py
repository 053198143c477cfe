"""Footage of the procedural subject whose truth is known: head, camera and matte of every frame.

- `motion`: a person who talks, blinks and turns, as head parameters
- `scenes`: that person before one static camera (`talk`), still with a camera that circles (`orbit`), before three
  cameras (`three`)
- `truth.FootageTruth`: what is known of every frame, as one file
- `rendering`, `backgrounds`: the frames
- `dataset_views`: the same of frames that a dataset has, such as path-traced ones
- `oracle_landmarks`, `oracle_recordings`: landmarks by the truth, with the errors of a network, and what tracking reads
- `tracked_heads`, `matte_errors`, `trained_footage`, `landmark_places`: commands that compare heads, mattes, avatars
  and places of landmarks with the truth

`python -m evaluation.benchmarks.footage OUT --kind talk` writes frames or a video, mattes, and the truth.
"""
