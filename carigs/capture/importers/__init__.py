"""Captures in other forms, turned into the layout of GaussianAvatars.

- `cameras`: a COLMAP model, or cameras.json
- `images`: folders of images by timestep and camera
- `calibrated_images`: a capture of both; its heads are not known yet
- `mesh_sequence`: a tracked mesh per frame, turned into a head model of its own
- `ava256`, `multiface`: captures of these datasets as `dome.Dome`, made a dataset by `dome.import_dome`
- `registration`: what both store of registered meshes; `unpacked`: images of Ava-256, taken out of their archives
- `flame_tracks`: FLAME parameters of VHAP, or one npz per frame
"""
