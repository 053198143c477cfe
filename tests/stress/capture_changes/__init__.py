"""Changes of a sound capture: damages, which must be noticed, and oddities, which must be accepted.

- `folder`: a copy of a capture
- `edits`: what changes are made of
- `cameras`, `parameters`, `images`, `head_model`: damages by the files that have them
- `oddities`: unusual captures that are sound
- `cases`: all of them
"""
