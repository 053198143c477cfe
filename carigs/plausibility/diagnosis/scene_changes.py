"""Changes of a scene: of its cameras as they are stored, its heads, its images and the assignment of the two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from carigs.capture import OPENCV_FROM_OPENGL, Camera
from carigs.plausibility.diagnosis.scene import Scene, Shot

Change = Callable[[Scene], Scene]
Matrix = Float[np.ndarray, "4 4"]
MILLIMETRE = 1e-3


def change_matrices(change: Callable[[Matrix], Matrix]) -> Change:
    """Change the cameras' transforms.

    Args:
        change: Of the transform as it is stored: OpenGL camera-to-world.

    Returns:
        The change of a scene.
    """

    def changed(camera: Camera) -> Camera:
        world_from_opengl = np.linalg.inv(camera.camera_from_world) @ OPENCV_FROM_OPENGL
        return replace(camera, camera_from_world=OPENCV_FROM_OPENGL @ np.linalg.inv(change(world_from_opengl)))

    return lambda scene: scene.with_cameras(changed)


def change_intrinsics(change: Callable[[Camera], dict[str, float]]) -> Change:
    """Change the cameras' intrinsics.

    Args:
        change: From a camera to some of its fields fx, fy, cx, cy.

    Returns:
        The change of a scene.
    """
    return lambda scene: scene.with_cameras(lambda camera: replace(camera, **change(camera)))


def scale_intrinsics(factor: float) -> Change:
    """Multiply focal lengths and principal points.

    Args:
        factor: The factor.

    Returns:
        The change of a scene.
    """
    return change_intrinsics(
        lambda c: {"fx": factor * c.fx, "fy": factor * c.fy, "cx": factor * c.cx, "cy": factor * c.cy}
    )


def scale_positions(factor: float) -> Change:
    """Multiply the positions of the cameras.

    Args:
        factor: The factor.

    Returns:
        The change of a scene.
    """
    return change_matrices(lambda m: np.block([[m[:3, :3], factor * m[:3, 3:]], [m[3:]]]))


def scale_translations(factor: float) -> Change:
    """Multiply the translations of the heads.

    Args:
        factor: The factor.

    Returns:
        The change of a scene.
    """

    def change(scene: Scene) -> Scene:
        heads = {
            t: replace(head, vertices=head.vertices + (factor - 1) * head.translation)
            for t, head in scene.heads.items()
        }
        return replace(scene, heads=heads)

    return change


def flip_images(*axes: int) -> Change:
    """Mirror images and mattes.

    Args:
        axes: 0 to turn them upside down, 1 to exchange left and right.

    Returns:
        The change of a scene.
    """

    def flipped(shot: Shot) -> Shot:
        matte = None if shot.matte is None else np.flip(shot.matte, axes)
        return replace(shot, image=np.ascontiguousarray(np.flip(shot.image, axes)), matte=matte)

    return lambda scene: scene.with_shots(flipped)


def shift_time(step: int) -> Change:
    """Let each shot show the head of another timestep; shots without one are left out.

    Args:
        step: 1 for the next timestep, -1 for the previous one.

    Returns:
        The change of a scene.
    """

    def change(scene: Scene) -> Scene:
        known = sorted(scene.heads)
        place = {t: i + step for i, t in enumerate(known)}
        shots = [shot for shot in scene.shots if 0 <= place[shot.timestep] < len(known)]
        return replace(scene, shots=tuple(replace(shot, timestep=known[place[shot.timestep]]) for shot in shots))

    return change


def in_turn(*changes: Change) -> Change:
    """Make several changes.

    Args:
        changes: The changes.

    Returns:
        The change of a scene.
    """

    def change(scene: Scene) -> Scene:
        for each in changes:
            scene = each(scene)
        return scene

    return change
