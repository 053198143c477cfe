"""Captures: cameras, images, datasets on disk, and the indexes of rendered frames and of GT* frames.

- `Camera`, `look_at`: pinhole cameras
- `Capture`, `Frame`: index of a subject's images, masks, cameras and head parameters
- `read_dataset`: read and check a dataset in the layout of GaussianAvatars
"""

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera, look_at
from carigs.capture.dataset import Capture
from carigs.capture.frame import Frame
from carigs.capture.gaussian_avatars import read_dataset

__all__ = ["OPENCV_FROM_OPENGL", "Camera", "Capture", "Frame", "look_at", "read_dataset"]
