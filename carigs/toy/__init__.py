"""The procedural subject: a synthetic head in the formats of a real capture, with reference images of its caricatures.

- `write_capture`: write a multi-view capture to disk
- `make_subject`, `load_subject`: build the subject of a seed, or read that of a written capture
- `render_subject`: the reference image of an expression, camera and caricature
- `pose_subject`: the same in two steps, for several cameras
- `head_model`: the head model in FLAME's format

Subpackages: `shape` (template mesh, in millimetres), `rig` (blendshapes, joints, regions, in millimetres) and `look`
(texture, hair, teeth, light, renderer). `head_model`, `ToySubject` and everything in the world are in metres.
"""

from carigs.toy.renderer import pose_subject, render_subject
from carigs.toy.rig.head_model import head_model
from carigs.toy.subject import ToySubject, load_subject, make_subject
from carigs.toy.writer import write_capture

__all__ = [
    "ToySubject",
    "head_model",
    "load_subject",
    "make_subject",
    "pose_subject",
    "render_subject",
    "write_capture",
]
