"""Captures: cameras, datasets on disk, the synthetic subject.

- `Camera`, `look_at`: pinhole cameras
- `Capture`, `Frame`: the checked index of a subject's images, masks, cameras and head parameters
- `read_dataset`: a folder in the GaussianAvatars layout -> `Capture`
- `carigs.capture.toy`: the procedural person
"""

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera, look_at
from carigs.capture.dataset import Capture, Frame
from carigs.capture.gaussian_avatars import read_dataset

__all__ = ["OPENCV_FROM_OPENGL", "Camera", "Capture", "Frame", "look_at", "read_dataset"]
