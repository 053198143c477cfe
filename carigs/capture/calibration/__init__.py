"""What files say of cameras: keys that carigs honours, values that mean a pinhole camera, and whether they are sound.

- `keys`: keys of a calibration that carigs knows; `pinhole_values`: values that mean no distortion and no skew
- `camera_table`: the cameras of a file; `camera_checks`: whether numbers of a camera can be right
"""
