"""Faces in images: where they are, and 478 landmarks of one of them, by the networks of MediaPipe.

- `network`, `graph_cut`: networks of TensorFlow Lite, and parts of them
- `face_detector`: boxes of faces; `attention_mesh`: landmarks in a crop; `crop`: rotated squares of an image
- `face_networks`: all of them; `face_tracking`: one face followed over time; `face_track`: its landmarks;
  `likeness`: whether two faces are of one person; `upright`: whether images are the right way up
- `mesh_indices`: which landmark lies where
"""

from carigs.detection.face_networks import FaceNetworks, load_face_networks
from carigs.detection.face_track import FaceTrack, collect
from carigs.detection.face_tracking import follow_face

__all__ = ["FaceNetworks", "FaceTrack", "collect", "follow_face", "load_face_networks"]
