"""Captures of a dome with a registered mesh and a head pose per frame: what Ava-256 and Multiface have in common.

The world of the dataset that is made is the head's own frame at the neutral frame, which has y up and the face towards
+z; the cameras of a dome stand in a frame of the dome.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from carigs.capture.calibration.camera_checks import check_intrinsics, check_rigid
from carigs.capture.camera import Camera
from carigs.capture.dataset import Capture
from carigs.capture.frame import Frame
from carigs.capture.importers.mesh_sequence import MeshTrack, track_meshes
from carigs.capture.importers.registration import MeshesOnDisk
from carigs.capture.splits import split_frames, split_single_sequence
from carigs.errors import CarigsWarning, InputError

TOLERANCE = 1e-4
"""Root mean square in metres of the distances of vertices that the blendshapes may leave."""
LARGEST_TILT = 60.0
"""Degrees between what the cameras call up and the head's y, and between the side that they see and its z, beyond which
the head's frame has other axes."""
ALL_AROUND = 0.2
"""Length of the mean direction of the cameras below which they stand on all sides and tell no front."""
FROM_THE_TOP = "opencv: calibrations of domes count from the top"


class View(NamedTuple):
    """What a camera of a dome has seen."""

    camera: Camera
    """Its pose is that of the calibration, in metres."""
    images: dict[int, str]
    """Paths by timestep, relative to the folder of the capture; of an image in an archive, `ARCHIVE/FRAME.avif`."""
    mattes: dict[int, str]
    """Likewise; the image itself if it gets its matte as it is unpacked."""


class DomeFrame(NamedTuple):
    """A frame of a capture."""

    timestep: int
    segment: str
    """Name of the expression or sentence."""


@dataclass(frozen=True)
class Dome:
    """A capture of a dome. Meshes and images are read on demand."""

    folder: Path
    frames: Sequence[DomeFrame]
    faces: Int[np.ndarray, "f 3"]
    vertices: Sequence[Float[np.ndarray, "v 3"]]
    """Of each frame, in metres, in the head's own frame."""
    world_from_head: Float[np.ndarray, "t 4 4"]
    """Head pose of each frame in the dome, in metres."""
    poses: Mapping[str, Float[np.ndarray, "4 4"]]
    """`camera_from_world` of each camera in the dome, in metres."""
    view: Callable[[str], View]
    """Looks for the images of a camera."""
    neutral_segments: tuple[str, ...]
    """Segments whose frames show the neutral head."""
    test_segments: tuple[str, ...]
    """Segments that the authors hold out, the first that is there."""


def import_dome(
    dome: Dome, head_model: Path, *, cameras: int, neutral: int | None = None, background: float = 1.0
) -> tuple[MeshTrack, Capture]:
    """Make a head model and the index of a dataset.

    Args:
        dome: The capture.
        head_model: File of the head model to be.
        cameras: Largest number of cameras. They are spread over the directions from which the head is seen.
        neutral: Timestep of the neutral head. None: the frame of the neutral segments, or of all if there are none,
            that is nearest to the mean of these frames.
        background: Grey value behind the head.

    Returns:
        The head model with its parameters, and the capture, whose frames are sorted by camera. The camera that sees the
        face most from the front is that of the validation frames.

    Raises:
        InputError: If a frame or camera cannot be used, or no images of two timesteps are left.

    Warns:
        CarigsWarning: The cameras see the head from behind, or not upright, so that its frame was turned.
    """
    for (timestep, _), motion in zip(dome.frames, dome.world_from_head, strict=True):
        check_rigid(motion, dome.folder, f"head pose of frame {timestep}")
    for name, pose in dome.poses.items():
        check_rigid(pose, dome.folder, f"camera {name}")
    place = _neutral_place(dome, neutral)
    dome = _upright(dome, place)
    world_from_head = dome.world_from_head
    track = track_meshes(
        dome.vertices,
        dome.faces,
        [frame.timestep for frame in dome.frames],
        neutral=place,
        world_from_head=np.linalg.inv(world_from_head[place]) @ world_from_head,
        tolerance=TOLERANCE,
    )
    poses = {name: pose @ world_from_head[place] for name, pose in dome.poses.items()}
    names = spread_cameras(poses, cameras)
    segments, frames, calibrations = dict(dome.frames), [], []
    for number, name in enumerate(sorted(names)):
        view = dome.view(name)
        calibrations.append(replace(view.camera, camera_from_world=poses[name]))
        check_intrinsics(calibrations[-1], dome.folder, f"camera {name}")
        frames += [
            Frame(
                timestep=timestep,
                camera=number,
                sequence=segments[timestep],
                split="train",
                image=image,
                mask=view.mattes.get(timestep),
                parameters="",
                calibration=number,
            )
            for timestep, image in sorted(view.images.items())
            if timestep in segments
        ]
    if len({frame.timestep for frame in frames}) < 2:
        raise InputError("holds images of fewer than two frames that have a mesh and a head pose", file=dome.folder)
    frontal = sorted(names).index(names[0])
    test = next((name for name in dome.test_segments if name in {f.sequence for f in frames}), None)
    if test is None or len({frame.sequence for frame in frames}) == 1:
        divided, rule = split_single_sequence(frames), "files"
    else:
        others = any(frame.camera != frontal and frame.sequence != test for frame in frames)
        divided, rule = split_frames(frames, test, frontal if others else None, dome.folder)
    capture = Capture(dome.folder, head_model, divided, tuple(calibrations), background, rule, FROM_THE_TOP)
    return track, capture


def spread_cameras(poses: Mapping[str, Float[np.ndarray, "4 4"]], count: int) -> list[str]:
    """Choose cameras that see the head from all sides.

    Args:
        poses: `camera_from_world` of each camera; the head is at the origin and looks to +z.
        count: Most cameras to choose.

    Returns:
        Names: first the camera that sees the face most from the front, then always the one whose direction is farthest
        from those of all before it.
    """
    names = sorted(poses)
    centres = np.stack([-poses[name][:3, :3].T @ poses[name][:3, 3] for name in names])
    directions = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    chosen = [int(directions[:, 2].argmax())]
    nearest = directions @ directions[chosen[0]]
    while len(chosen) < min(count, len(names)):
        nearest[chosen] = np.inf
        chosen.append(int(nearest.argmin()))
        nearest = np.maximum(nearest, directions @ directions[chosen[-1]])
    return [names[i] for i in chosen]


def _neutral_place(dome: Dome, neutral: int | None) -> int:
    """Position of the frame that is the neutral head."""
    if neutral is not None:
        places = [i for i, frame in enumerate(dome.frames) if frame.timestep == neutral]
        if not places:
            raise InputError(f"there is no frame {neutral} with a mesh and a head pose", file=dome.folder)
        return places[0]
    places = [i for i, frame in enumerate(dome.frames) if frame.segment in dome.neutral_segments]
    places = places or list(range(len(dome.frames)))
    mean = sum(dome.vertices[i] for i in places) / len(places)
    return min(places, key=lambda i: float(((dome.vertices[i] - mean) ** 2).sum()))


def _upright(dome: Dome, place: int) -> Dome:
    """The capture with a head's frame that has y up and the face towards +z, as most of its cameras see it."""
    poses = [pose @ dome.world_from_head[place] for pose in dome.poses.values()]
    up = -np.mean([pose[1, :3] for pose in poses], axis=0)
    centres = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])
    front = (centres / np.linalg.norm(centres, axis=1, keepdims=True)).mean(axis=0)
    if np.linalg.norm(front) < ALL_AROUND:
        front = np.array([0.0, 0.0, 1.0])
    seen = np.stack([up, front]) / np.linalg.norm([up, front], axis=1, keepdims=True).clip(1e-9)
    if min(seen[0, 1], seen[1, 2]) > np.cos(np.radians(LARGEST_TILT)):
        return dome
    turns = [turn.as_matrix() for turn in Rotation.create_group("O")]  # what maps axes to axes
    turn = max(turns, key=lambda turn: float((seen @ turn.T)[[0, 1], [1, 2]].sum()))
    problem = "the head's frame does not have y up and the face towards +z as the cameras see it: it was turned"
    warnings.warn(CarigsWarning(f"{dome.folder}: {problem}"), stacklevel=3)
    world_from_head = dome.world_from_head.copy()
    world_from_head[:, :3, :3] = world_from_head[:, :3, :3] @ turn.T
    turned = MeshesOnDisk(len(dome.vertices), lambda i: dome.vertices[i] @ turn.T)
    return replace(dome, vertices=turned, world_from_head=world_from_head)
