"""Sound files of other programs for the stress test of readers, and what reads them.

- `ball`: a head model
- `captures`: COLMAP models, cameras.json, mesh sequences, tracks, datasets and conversions
- `splats`: .ply files of GaussianAvatars and SurFhead, with their parameters, and conversions of avatars
- `heads`: landmarks, embeddings, ICT-FaceKit, downloads

Each module has `write_sound_files(folder)` and `READERS`, by name a function and the path of its file.
"""
