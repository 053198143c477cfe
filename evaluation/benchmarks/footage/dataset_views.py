"""Footage whose truth is known, composed of the frames of a dataset with exact parameters, such as path-traced ones.

- `talk`: the frames of the most frontal camera, in the order of the timesteps. Where a sequence ends, the head jumps.
- `orbit`: the frames of one timestep, from the person's right to its left: a camera that circles a still person, in as
  many steps as there are cameras
- `three`: the frames of the cameras nearest to `SIDES`
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture, Frame
from carigs.capture.camera import Camera
from evaluation.benchmarks.footage.scenes import SIDES
from evaluation.benchmarks.footage.truth import FootageTruth

FPS = 25.0
"""Of what never was a video."""


def dataset_footage(capture: Capture, kind: str, timestep: int = 0) -> tuple[FootageTruth, list[list[Frame]]]:
    """Choose the frames of a dataset that are footage of a kind.

    Args:
        capture: A calibrated dataset, whose cameras look at a person who faces +z.
        kind: `talk`, `orbit` or `three`.
        timestep: That of `orbit`.

    Returns:
        The truth, and the frames of each timestep and camera.
    """
    azimuths = {number: azimuth(camera) for number, camera in capture.cameras.items()}
    timesteps = sorted({frame.timestep for frame in capture.frames})
    if kind == "orbit":
        chosen = [[(timestep, number)] for number in sorted(azimuths, key=azimuths.__getitem__)]
    else:
        wanted = SIDES if kind == "three" else (0.0,)
        nearest = [min(azimuths, key=lambda number: abs(azimuths[number] - side)) for side in wanted]
        chosen = [[(t, number) for number in nearest] for t in timesteps]
    frames = [[capture.frame_at[key] for key in keys] for keys in chosen]
    parameters = [capture.parameters(keys[0][0]) for keys in chosen]
    cameras = [[capture.camera(frame) for frame in seen] for seen in frames]
    return FootageTruth(capture.model, parameters, cameras, FPS), frames


def azimuth(camera: Camera) -> float:
    """Where a camera stands.

    Args:
        camera: A camera that looks at the person, who faces +z.

    Returns:
        Degrees to the person's left.
    """
    x, _, z = -camera.world_from_camera[:3, 2]
    return float(np.degrees(np.arctan2(x, z)))


def dataset_person(
    capture: Capture, frames: list[list[Frame]], camera: int = 0
) -> Iterator[tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]]:
    """Images and mattes of a camera, as `rendering.person` yields those of the toy.

    Args:
        capture: The dataset; its background is white, and it has mattes.
        frames: Of each timestep and camera.
        camera: Position of the camera among them.

    Yields:
        RGB over white and opacity of each timestep, in [0, 1].
    """
    for seen in frames:
        frame = seen[camera]
        yield capture.image(frame), capture.mask(frame)
