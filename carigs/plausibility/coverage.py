"""From where the training frames see a head, and which of its parts no frame shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.held_out_poses import facing
from carigs.capture.splits import ENOUGH_CAMERAS
from carigs.head import HeadModel, neutral, pose
from carigs.head.facial_regions import lid_faces
from carigs.mesh.triangle_mesh import barycenters, face_areas, face_normals
from carigs.plausibility.findings import Finding
from carigs.plausibility.views import head_faces
from carigs.raster.seen_triangles import seen_triangles

FRAMES, DIRECTIONS = 32, 256
"""Most training frames whose triangles are looked at, and most of which only the direction counts."""
SIDE = 320
"""Pixels of the longer side at which they are looked at."""
GRAZING = 0.1
"""Cosine between normal and direction to the camera up to which a triangle counts as unseen."""
UNSEEN, PARTLY = 0.05, 0.4
"""Shares of the area of a part up to which nothing, and little, is seen of it."""
ALL_AROUND = 90.0
"""Degrees between neighbouring directions up to which cameras stand all around."""


class Coverage(NamedTuple):
    """What training frames see of a head."""

    cameras: int
    azimuth: tuple[float, float] | None
    """Degrees about the vertical axis of the head, to the person's left, between which the directions to the cameras
    lie; the second is larger, and above 180 if they lie around the back of the head. None: all around."""
    elevation: tuple[float, float]
    """Degrees above the horizon of the head."""
    unseen: tuple[str, ...]
    """Parts that no frame shows."""
    partly: tuple[str, ...]
    """Parts of which frames show little."""

    def __str__(self) -> str:
        see = "1 camera sees" if self.cameras == 1 else f"{self.cameras} cameras see"
        around = "from all around" if self.azimuth is None else _between(self.azimuth, ("right", "left"), "the front")
        parts = [f"nothing sees {_listed(self.unseen)}"] if self.unseen else []
        parts += [f"little is seen of {_listed(self.partly)}"] if self.partly else []
        level = _between(self.elevation, ("below", "above"), "at its own height").removeprefix("from ")
        return f"{see} the head {around}, {level}: {'; '.join(parts) or 'every part is seen'}"


def capture_coverage(capture: Capture) -> Coverage | None:
    """Find what the training frames of a capture see of the head.

    Args:
        capture: The capture; its head lies where the images show it.

    Returns:
        What they see; None without training frames.

    Raises:
        InputError: If head parameters cannot be read.
        MeshError: If a head cannot be posed.
    """
    frames, model = capture.split("train"), capture.model
    if not frames:
        return None
    some = evenly_spread(frames, DIRECTIONS)
    parameters = [capture.parameters(frame.timestep) for frame in some]
    towards = facing(model, parameters, [capture.camera(frame) for frame in some])[:, 2]
    best = np.full(len(model.faces), -1.0)
    for frame in evenly_spread(frames, FRAMES):
        camera = capture.camera(frame)
        camera = camera.scaled(min(SIDE / max(camera.width, camera.height), 1.0))
        seen = seen_triangles(pose(model, capture.parameters(frame.timestep)), model.faces, camera)
        best[seen.index] = np.maximum(best[seen.index], seen.cosine)
    rest = neutral(model, parameters[0])
    area, shares = face_areas(rest, model.faces), dict[str, float]()
    for name, part in head_parts(model, rest).items():
        if part.any():
            shares[name] = float(area[part & (best > GRAZING)].sum() / max(area[part].sum(), 1e-12))
    elevation = np.degrees(np.arcsin(towards[:, 1].clip(-1, 1)))
    return Coverage(
        len({frame.camera for frame in frames}),
        _interval(np.degrees(np.arctan2(towards[:, 0], towards[:, 2]))),
        (float(elevation.min()), float(elevation.max())),
        tuple(name for name, share in shares.items() if share <= UNSEEN),
        tuple(name for name, share in shares.items() if UNSEEN < share <= PARTLY),
    )


def head_parts(model: HeadModel, rest: Float[np.ndarray, "v 3"]) -> dict[str, Bool[np.ndarray, " f"]]:
    """Find the triangles of the parts of a head that people have names for.

    Args:
        model: The head model; ears and lids are known by its regions.
        rest: Vertices of the neutral head in metres, y up, the face towards +z.

    Returns:
        Outer triangles by the name of the part; none of parts that the model does not have.
    """
    centre, normal = barycenters(rest, model.faces), face_normals(rest, model.faces)
    corners = rest[np.unique(model.faces[head_faces(model)])]
    low, high = corners.min(axis=0), corners.max(axis=0)
    arm = centre - (low + high) / 2
    length = np.maximum(np.linalg.norm(arm, axis=1), 1e-9)
    left, up = np.degrees(np.arctan2(arm[:, 0], arm[:, 2])), np.degrees(np.arcsin(arm[:, 1] / length))
    inner = model.face_region("left_eyeball", "right_eyeball", "lip_inside")
    outer = (np.einsum("nc,nc->n", normal, arm) > 0.3 * length) & ~inner
    ears = {side: model.face_region(f"{side}_ear") for side in ("left", "right")}
    skin, away = outer & ~ears["left"] & ~ears["right"], np.abs(left)
    level = skin & (up > -15) & (up < 55)
    below = (arm[:, 1] < -0.3 * (high - low)[1]) & (normal[:, 1] < -0.5) & (arm[:, 2] > 0)
    return {
        "the face": level & (away < 45),
        "the left side of the head": level & (left > 60) & (left < 120),
        "the right side of the head": level & (left < -60) & (left > -120),
        "the left ear": ears["left"] & outer,
        "the right ear": ears["right"] & outer,
        "the top of the head": skin & (up > 60),
        "the back of the head": level & (away > 140),
        "the nape": skin & (away > 140) & (up <= -20),
        "the skin under the chin": below & ~inner & (away < 60),
        "the eyelids": lid_faces(model, rest) & (normal[:, 2] > 0.5),
    }


def lost_camera(capture: Capture) -> Finding | None:
    """Find a camera of few whose frames are all for validation, because the files say so.

    Args:
        capture: The capture.

    Returns:
        The finding; None if the user has named the camera, or if enough cameras are left.
    """
    lost = {frame.camera for frame in capture.split("val")}
    count = len(capture.cameras)
    if not capture.split_rule.split(";")[0] == "files" or count >= ENOUGH_CAMERAS or len(lost) != 1 or count < 2:
        return None
    camera = lost.pop()
    if any(frame.camera == camera for frame in capture.split("train")):
        return None
    kind = f"the split takes one of {count} cameras away from the training"
    remedy = "hold out timesteps instead (capture.split=blocks, or the name of a sequence)"
    return Finding(kind, capture.root, f"camera {camera}", "all frames that are not for tests validate", remedy)


def _interval(angles: Float[np.ndarray, " n"]) -> tuple[float, float] | None:
    """The shortest arc that holds all angles; None if they lie all around."""
    ordered = np.sort(angles)
    gaps = np.diff(np.append(ordered, ordered[0] + 360))
    after = int(gaps.argmax())
    if gaps[after] <= ALL_AROUND:
        return None
    first, last = float(ordered[(after + 1) % len(ordered)]), float(ordered[after])
    return first, last if last >= first else last + 360


def _between(angles: tuple[float, float], names: tuple[str, str], zero: str) -> str:
    """An interval in words; the larger one first where it goes to the left."""
    low, high = (round(angle) for angle in angles)

    def side(angle: int) -> str:
        return f"{abs(angle)} degrees {names[angle > 0]}"

    if low == high:
        return f"from {side(low) if low else zero}"
    if high > 180:
        return f"from {side(low)} around the back to {side(high - 360)}"
    if low * high > 0:
        return f"from {abs(low)} to {side(high)}" if low > 0 else f"from {abs(high)} to {side(low)}"
    return f"from {side(high)} to {side(low)}" if names[1] == "left" else f"from {side(low)} to {side(high)}"


def _listed(names: Sequence[str]) -> str:
    """Names with commas, and `and` before the last one."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
