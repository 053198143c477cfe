"""Motion: what drives a head, its files, and its transfer to another head.

- `Motion`: coefficients of expressions by name, rotations of joints, and the pose of the head, at a frame rate
- `read_motion`, `write_motion`: files of carigs, of Live Link Face, of MediaPipe and of FLAME trackers
- `idle`, `talk`: motions without a file
- `Retargeting`: one head's motion for another one
- `editing`: frame rate, length, loops, sides, neutral expression, strength of parts of the face
"""

from carigs.motion.built_in import BUILT_IN
from carigs.motion.files import read_motion, write_motion
from carigs.motion.motion import Motion
from carigs.motion.retargeting import Retargeting

__all__ = ["BUILT_IN", "Motion", "Retargeting", "read_motion", "write_motion"]
