"""Footage becomes a tracked dataset, and is judged.

- `quality.TrackedFrames`: what is known of the frames of one camera
- `coverage`: from which sides they show the head
- `advice`: what to record otherwise, in sentences
- `error_table`, `contact_sheet`: errors of regions, and frames with the mesh
"""
