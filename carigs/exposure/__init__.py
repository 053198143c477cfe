"""Exposure: how brightly, in which white balance and how sharply cameras show the same head.

- `measure_exposures`: cameras against each other, and against themselves at other times
- `match_exposures`: factors on the light of training frames
- `camera_sharpness`, `frame_sharpness`: cameras out of focus, frames blurred by motion
- `band_strength`: frames whose brightness changes from row to row
"""

from carigs.exposure.bands import band_strength
from carigs.exposure.matching import Exposures, match_exposures, measure_exposures
from carigs.exposure.sharpness import camera_sharpness, frame_sharpness

__all__ = [
    "Exposures",
    "band_strength",
    "camera_sharpness",
    "frame_sharpness",
    "match_exposures",
    "measure_exposures",
]
