"""The inside of the mouth: which triangles the two jaws move, and points that cameras see between the lips.

Head models without teeth end at a bag behind the lips, which stretches with them. Teeth do not: the upper ones stay
with the skull, the lower ones move with the jaw.

- `find_jaws`, `Jaw`: triangles that move with the skull and with the jaw
- `has_teeth`: whether a model has its own teeth
- `place_in_mouth`: points between them, for surfels
- `lip_line`, `LipLine`, `lip_gap`: where the mouth opens, and how far
"""

from carigs.mouth.jaw import Jaw
from carigs.mouth.jaws import find_jaws, has_teeth
from carigs.mouth.lip_line import LipLine, lip_gap, lip_line
from carigs.mouth.placement import place_in_mouth

__all__ = ["Jaw", "LipLine", "find_jaws", "has_teeth", "lip_gap", "lip_line", "place_in_mouth"]
