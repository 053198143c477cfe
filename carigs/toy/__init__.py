"""The procedural person: a synthetic subject in the formats of a real one, and its true caricatures.

- `write_capture`: a whole multi-view capture on disk
- `make_subject`, `load_subject`: the person of a seed; the person of a written capture
- `render_subject`: a true image of any expression, camera and caricature
- `head_model`: the head model in FLAME's format
"""

from carigs.toy.look.renderer import render_subject
from carigs.toy.rig.head_model import head_model
from carigs.toy.subject import Subject, load_subject, make_subject
from carigs.toy.writer import write_capture

__all__ = ["Subject", "head_model", "load_subject", "make_subject", "render_subject", "write_capture"]
