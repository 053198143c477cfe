"""Tables of Live Link Face, which Unreal, Blender and Unity import."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from carigs.errors import SettingsError
from carigs.motion.facial_actions import ARKIT, actions, name_map
from carigs.motion.motion import Motion
from carigs.system.files import writing

ANGLES = tuple(f"{what}{angle}" for what in ("Head", "LeftEye", "RightEye") for angle in ("Yaw", "Pitch", "Roll"))


def write_live_link(file: Path, motion: Motion) -> None:
    """Write the columns of Live Link Face.

    The two sides of an expression that ARKit does not split become columns of their own behind the others, where they
    differ, and so do joints: `read_motion` reads all of it back, other programs skip what they do not know.

    Args:
        file: Path to write (.csv).
        motion: The motion.

    Raises:
        SettingsError: If no expression has a name of ARKit.
    """
    known = [place for place, name in enumerate(motion.names) if actions(name)]
    if not known:
        raise SettingsError("motion: no expression has a name that ARKit knows, such as jawOpen")
    names = [motion.names[place] for place in known]
    arkit = motion.expression[:, known] @ name_map(names, ARKIT).T
    again = arkit @ name_map(ARKIT, names).T  # what a reader of ARKit's names would find
    apart = [i for i, place in enumerate(known) if np.abs(again[:, i] - motion.expression[:, place]).max() > 1e-9]
    columns = {name[0].upper() + name[1:]: arkit[:, i] for i, name in enumerate(ARKIT)}
    relative = Rotation.from_rotvec(motion.rest_rotation).inv() * Rotation.from_rotvec(motion.rotation)
    yaw, pitch, roll = (relative.as_euler("YXZ") * [-1.0, 1.0, -1.0]).T
    angles = dict(zip(ANGLES[:3], (yaw, pitch, roll), strict=True))
    columns |= {name: angles.get(name, np.zeros(len(motion))) for name in ANGLES}
    for i in apart:
        columns[motion.names[known[i]]] = motion.expression[:, known[i]]
    vectors = {name: array for name, array in motion.joints.items() if array.any()}
    if motion.rotation.any() or motion.translation.any():
        vectors |= {"rotation": motion.rotation, "translation": motion.translation}
        vectors |= {
            f"rest_{n}": np.tile(getattr(motion, f"rest_{n}"), (len(motion), 1)) for n in ("rotation", "translation")
        }
    for name, array in vectors.items():
        columns |= {f"{name}_{axis}": column for axis, column in zip("xyz", array.T, strict=True)}
    rate = round(motion.fps)
    rows = np.stack(list(columns.values()), axis=1).tolist()
    lines = [",".join(["Timecode", "BlendshapeCount", *columns])]
    for i, row in enumerate(rows):
        seconds, frame = divmod(i * rate / motion.fps, rate)
        hours, minutes, second = int(seconds) // 3600, int(seconds) // 60 % 60, int(seconds) % 60
        timecode = f"{hours:02d}:{minutes:02d}:{second:02d}:{frame:06.3f}"
        lines.append(",".join([timecode, "61", *(f"{value:.10g}" for value in row)]))
    with writing(file) as part:
        part.write_text("\n".join([*lines, ""]), encoding="utf-8")
