"""Scenes of the surfel engine's benchmarks: surfels on an ellipsoid of a head's size, and a head to train on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import trimesh
from jaxtyping import Float

from carigs.capture import Camera, Capture, Frame, look_at
from carigs.capture.images import write_png
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import HeadModel, HeadParameters, pose
from carigs.raster import rasterize_mesh
from carigs.splat.rasterizer.rasterize import WorldSurfels
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.training.supervision import Supervision

AXES = np.array([0.075, 0.11, 0.09])
"""Half axes of the ellipsoid in metres."""
SPACINGS = 0.3
"""Mean standard deviation of a surfel in units of the distance to its neighbour."""


def portrait(width: int, height: int, side: float = 0.0) -> Camera:
    """Camera at a distance of 1 m; the ellipsoid covers about half of its image.

    Args:
        width: Image width in pixels.
        height: Image height in pixels.
        side: Angle from the front in radians.

    Returns:
        The camera.
    """
    focal = float(np.sqrt(0.5 * width * height / (np.pi * AXES[0] * AXES[1])))
    position = np.array([np.sin(side), 0.0, np.cos(side)])
    return Camera(look_at(position, np.zeros(3)), focal, focal, width / 2, height / 2, width, height)


def surfels_on_ellipsoid(count: int, *, spread: float = 1.0, seed: int = 0) -> WorldSurfels:
    """Distribute surfels evenly over the ellipsoid, with jittered normals.

    They are in random order, the worst case for caches.

    Args:
        count: Number of surfels.
        spread: Factor of their size; 2 makes the dense scene.
        seed: Seed of positions, sizes and colours.

    Returns:
        Surfels that require gradients.
    """
    random = np.random.default_rng(seed)
    point = _unit(random.normal(size=(4 * count + 100, 3)))
    stretch = np.linalg.norm(point / AXES, axis=1)  # of the ellipsoid's area against the sphere's
    point = point[random.random(len(point)) < stretch * AXES.min()][:count]
    normal = _unit(_unit(point / AXES) + random.normal(0, 0.15, (count, 3)))
    u = _unit(np.cross(normal, random.normal(size=(count, 3))))
    a, b, c = AXES**1.6075
    area = float(4 * np.pi * ((a * b + a * c + b * c) / 3) ** (1 / 1.6075))  # to 1 % (Knud Thomsen's formula)
    sigma = spread * SPACINGS * np.sqrt(area / count) * random.uniform(0.6, 1.4, (count, 2))
    tangents = sigma[:, :1] * u, sigma[:, 1:] * np.cross(normal, u)
    arrays = (AXES * point, *tangents, random.uniform(0.1, 0.99, count), random.random((count, 3)))
    return WorldSurfels(*(torch.from_numpy(array.astype(np.float32)).requires_grad_(True) for array in arrays))


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def scene_name(surfels: int, camera: Camera, threads: int, *more: str) -> str:
    """Name of a case in the records of a benchmark.

    Args:
        surfels: Number of surfels.
        camera: Camera.
        threads: Number of threads.
        more: Further descriptions.

    Returns:
        The name.
    """
    size = f"{camera.height}x{camera.width}"
    return ", ".join((f"{surfels} surfels", size, f"{threads} thread{'s' * (threads > 1)}", *more))


def moving_head(subdivisions: int, timesteps: int = 4) -> HeadSequence:
    """Build an ellipsoid that turns and opens its lower half over time.

    Args:
        subdivisions: Fineness: it has 20 * 4^subdivisions triangles.
        timesteps: Number of timesteps.

    Returns:
        The head and its motion.
    """
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    vertices = (np.asarray(mesh.vertices) * AXES).astype(np.float32)
    v = len(vertices)
    shapedirs = np.zeros((v, 3, 400), np.float32)
    shapedirs[:, 1, 300] = -0.02 * (vertices[:, 1] < -0.03)
    model = HeadModel(
        v_template=vertices,
        faces=np.asarray(mesh.faces, np.int32),
        shapedirs=shapedirs,
        posedirs=np.zeros((v, 3, 36), np.float32),
        joint_regressor=np.full((5, v), 1 / v, np.float32),
        weights=np.eye(5, dtype=np.float32)[np.zeros(v, int)],
        parents=np.array([-1, 0, 1, 1, 1]),
    )
    parameters = {
        t: HeadParameters(rotation=np.array([0, 0.1 * t, 0]), expression=0.3 * t * np.eye(100)[0])
        for t in range(timesteps)
    }
    path = straight_path(vertices.astype(np.float64), model.faces, 0.2 * vertices, 0.25)
    return HeadSequence(model, parameters, path)


def capture_images(sequence: HeadSequence, folder: Path, width: int, height: int) -> Supervision:
    """Render a head, painted with a pattern, from three sides at all timesteps.

    Args:
        sequence: The head and its motion.
        folder: Folder to write images and masks to.
        width: Image width in pixels.
        height: Image height in pixels.

    Returns:
        The images as supervision of a training.
    """
    cameras = {c: portrait(width, height, side) for c, side in enumerate((-0.4, 0.0, 0.4))}
    head, frames = sequence.head, []
    paint = 0.5 + 0.2 * np.sin(head.v_template @ np.array([[90, 250, 30], [200, -60, 110], [-40, 90, 300]]))
    for t in sequence.parameters:
        vertices = pose(head, sequence.parameters[t])
        for c, camera in cameras.items():
            hit = rasterize_mesh(vertices, head.faces, camera)
            image = np.einsum("hwc,hwcx->hwx", hit.barycentric, paint[head.faces[hit.face]])
            frame = Frame(t, c, "EMO-1", "train", f"{t}_{c}.png", f"{t}_{c}_mask.png", "", c)
            write_png(folder / frame.image, np.where(hit.face[..., None] >= 0, image, 1.0))
            write_png(folder / frame.mask, (hit.face >= 0).astype(np.float32))
            frames.append(frame)
    capture = Capture(folder, folder / "head_model.npz", tuple(frames), tuple(cameras.values()), background=1.0)
    return Supervision(capture)
