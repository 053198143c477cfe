"""The capture of a ball: a head model, images, mattes and parameters that every stage accepts, in 100 kB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from carigs.capture import Camera, Capture, Frame, look_at
from carigs.capture.images import write_png
from carigs.head import HeadModel, HeadParameters

RADIUS = 0.1
"""Radius of the ball in metres."""
SIZE = 48
"""Width and height of the images in pixels."""
NUM_TIMESTEPS = 3
"""Number of timesteps; the last one is in the split `test`."""


def write_ball_capture(folder: Path) -> Path:
    """Write the capture of a ball whose upper part is scalp; three cameras see it at each timestep.

    Args:
        folder: Folder to create.

    Returns:
        The index of the capture.
    """
    folder.mkdir(parents=True)
    model, frames = _model(), []
    model.save(folder / "head_model.npz")
    HeadParameters.zeros(model).save(folder / "parameters.npz", model)
    poses = [look_at(np.array([x, 0.05, 1.0]), np.zeros(3)) for x in (-0.4, 0.0, 0.4)]
    cameras = tuple(Camera(pose, 150, 150, SIZE / 2, SIZE / 2, SIZE, SIZE) for pose in poses)
    for c, camera in enumerate(cameras):
        matte, points = _ball_in(camera)
        write_png(folder / f"{c}.png", np.where(matte[..., None], 0.5 + 4 * points, 1.0).astype(np.float32))
        write_png(folder / f"{c}_matte.png", matte.astype(np.float32))
        for t in range(NUM_TIMESTEPS):
            split = "test" if t == NUM_TIMESTEPS - 1 else "val" if c == 1 else "train"
            frames.append(Frame(t, c, split, split, f"{c}.png", f"{c}_matte.png", "parameters.npz", c))
    frames.sort(key=lambda frame: (frame.timestep, frame.camera))
    index = folder / "capture.json"
    Capture(folder, folder / "head_model.npz", tuple(frames), cameras, background=1.0).save(index)
    return index


def _model() -> HeadModel:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
    v = len(ball.vertices)
    weights = np.zeros((v, 5), np.float32)
    weights[:, 0] = 1
    _, y, z = ball.vertices.T
    shapedirs = np.zeros((v, 3, 400), np.float32)
    shapedirs[:, :, 0] = 0.1 * ball.vertices
    shapedirs[:, 1, 300] = -0.02 * (y < -0.03)
    return HeadModel(
        v_template=np.asarray(ball.vertices, np.float32),
        faces=np.asarray(ball.faces, np.int32),
        shapedirs=shapedirs,
        posedirs=np.zeros((v, 3, 36), np.float32),
        joint_regressor=np.full((5, v), 1 / v, np.float32),
        weights=weights,
        parents=np.array([-1, 0, 1, 1, 1]),
        regions={"scalp": np.flatnonzero(y > 0.06), "face": np.flatnonzero((z > 0.05) & (y <= 0.06))},
        expression_names=("jawOpen",),
    )


def _ball_in(camera: Camera) -> tuple[Bool[np.ndarray, "h w"], Float[np.ndarray, "h w 3"]]:
    """Where a camera sees the ball, and which points of it: the first intersections of rays with a sphere."""
    origin = camera.world_from_camera[:3, 3]
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    rays = rays @ camera.world_from_camera[:3, :3].T
    a, b, c = (rays**2).sum(axis=-1), rays @ origin, origin @ origin - RADIUS**2
    discriminant = b**2 - a * c
    distance = (-b - np.sqrt(discriminant.clip(0))) / a
    return discriminant > 0, origin + distance[..., None] * rays
