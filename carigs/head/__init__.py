"""Head models: their files, tracked parameters, posing, and the caricature of a subject.

- `HeadModel`: any linear-blend-skinned head; `HeadModel.load` reads .npz and FLAME's .pkl
- `HeadParameters`: one tracked frame; reads and writes the npz layout of GaussianAvatars
- `neutral`, `pose`, `pose_frames`: vertices without and with expression, joint rotations and translation
- `subject_model`: the head model of one subject
- `SurfacePoints`: points on a head, such as its landmarks
- `subject_exaggerator`, `subject_gamma_path`: the solver and the path S_gamma of a subject
- `read_subject_path`: the path S_gamma from a file, checked against the head
- `carigs.head.teeth`: the teeth that are added to FLAME, on the natural head and on its caricatures
"""

from carigs.head.model import HeadModel
from carigs.head.parameters import HeadParameters, flame_joints
from carigs.head.posing import neutral, pose, pose_frames, posed_changes, subject_model
from carigs.head.subject_caricature import subject_exaggerator, subject_gamma_path
from carigs.head.subject_path import check_subject_path, read_subject_path
from carigs.head.surface_points import SurfacePoints

__all__ = [
    "HeadModel",
    "HeadParameters",
    "SurfacePoints",
    "check_subject_path",
    "flame_joints",
    "neutral",
    "pose",
    "pose_frames",
    "posed_changes",
    "read_subject_path",
    "subject_exaggerator",
    "subject_gamma_path",
    "subject_model",
]
