"""The usual mistakes of a capture, as changes of a scene that undo them.

| group | mistakes |
|---|---|
| axes | OpenCV axes, world-to-camera, both, transposed rotations, a mirrored axis, a world with z up or y down |
| units | millimetres in the cameras, in the head's translation, in both |
| intrinsics | `fl_y` negative, `cy` counted from below, those of another resolution, focal lengths in other units |
| images | mirrored, upside down |
| time | head parameters of the neighbouring timestep |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.capture import OPENCV_FROM_OPENGL, Camera
from carigs.plausibility.scene import Scene, Shot

Matrix = Float[np.ndarray, "4 4"]


class Hypothesis(NamedTuple):
    """A mistake."""

    group: str
    """Mistakes of one group exclude each other."""
    mistake: str
    """What is wrong."""
    remedy: str
    """What to do about it."""
    undo: Callable[[Scene], Scene]
    """From the stated scene to the supposed one."""
    cameras: frozenset[int] = frozenset()
    """The cameras that it concerns; empty if it concerns all."""


def _stored(change: Callable[[Matrix], Matrix]) -> Callable[[Scene], Scene]:
    """Change the transforms as they are stored: OpenGL camera-to-world."""

    def changed(camera: Camera) -> Camera:
        world_from_opengl = np.linalg.inv(camera.camera_from_world) @ OPENCV_FROM_OPENGL
        return replace(camera, camera_from_world=OPENCV_FROM_OPENGL @ np.linalg.inv(change(world_from_opengl)))

    return lambda scene: scene.with_cameras(changed)


def _metres(matrix: Matrix) -> Matrix:
    return np.block([[matrix[:3, :3], matrix[:3, 3:] / 1000], [matrix[3:]]])


def _metre_heads(scene: Scene) -> Scene:
    heads = {
        t: replace(head, vertices=head.vertices - 0.999 * head.translation, translation=head.translation / 1000)
        for t, head in scene.heads.items()
    }
    return replace(scene, heads=heads)


def _intrinsics(change: Callable[[Camera], dict[str, float]]) -> Callable[[Scene], Scene]:
    return lambda scene: scene.with_cameras(lambda camera: replace(camera, **change(camera)))


def _scaled_intrinsics(camera: Camera, factor: float) -> dict[str, float]:
    return dict(zip(("fx", "fy", "cx", "cy"), (factor * value for value in camera.intrinsics), strict=True))


def _flipped(shot: Shot, axis: int) -> Shot:
    matte = None if shot.matte is None else np.ascontiguousarray(np.flip(shot.matte, axis))
    return replace(shot, image=np.ascontiguousarray(np.flip(shot.image, axis)), matte=matte)


def _shifted_time(scene: Scene, step: int) -> Scene:
    """Each shot shows the head of the next or the previous timestep; shots without one are left out."""
    known = sorted(scene.heads)
    place = {t: i for i, t in enumerate(known)}
    shots = [
        replace(shot, timestep=known[place[shot.timestep] + step])
        for shot in scene.shots
        if 0 <= place[shot.timestep] + step < len(known)
    ]
    return replace(scene, shots=tuple(shots))


def _focal_units() -> list[tuple[str, Callable[[Camera], dict[str, float]]]]:
    """Focal lengths in other units: names, and fx and fy in pixels."""

    def scaled(x: float, y: float) -> Callable[[Camera], dict[str, float]]:
        """By x and y in widths and heights of the image."""
        return lambda c: {"fx": c.fx * x * c.width, "fy": c.fy * y * c.height}

    def by(size: str, factor: float = 1.0) -> Callable[[Camera], dict[str, float]]:
        return lambda c: {"fx": c.fx * factor * getattr(c, size), "fy": c.fy * factor * getattr(c, size)}

    def angle(unit: float, sizes: tuple[str, str]) -> Callable[[Camera], dict[str, float]]:
        def focal(c: Camera) -> dict[str, float]:
            half = np.clip([unit * c.fx / 2, unit * c.fy / 2], 1e-3, np.pi / 2 - 1e-3)
            return {
                key: getattr(c, size) / (2 * np.tan(h))
                for key, size, h in zip(("fx", "fy"), sizes, half.tolist(), strict=True)
            }

        return focal

    each, across, down = ("width", "height"), ("width", "width"), ("height", "height")
    degrees = "fields of view in degrees"
    return [
        ("shares of the image's width and height", scaled(1, 1)),
        ("shares of the image's width", by("width")),
        ("shares of the image's height", by("height")),
        ("shares of half the image's width and height", scaled(0.5, 0.5)),
        ("shares of half the image's width", by("width", 0.5)),
        ("millimetres on a sensor of 36 mm width", by("width", 1 / 36)),
        (degrees, angle(np.pi / 180, each)),
        (f"horizontal {degrees}", angle(np.pi / 180, across)),
        (f"vertical {degrees}", angle(np.pi / 180, down)),
        ("fields of view in radians", angle(1.0, each)),
        ("horizontal fields of view in radians", angle(1.0, across)),
        ("vertical fields of view in radians", angle(1.0, down)),
    ]


def _hypotheses() -> list[Hypothesis]:
    flip_yz, z_up = OPENCV_FROM_OPENGL, np.eye(4)[[0, 2, 1, 3]] * [[1], [1], [-1], [1]]
    mirror = {axis: np.diag(np.where(np.arange(4) == i, -1.0, 1.0)) for i, axis in enumerate("xyz")}
    cameras = "transform_matrix"
    found = [
        Hypothesis("axes", mistake, f"{cameras}: {remedy}", _stored(change))
        for mistake, remedy, change in (
            (
                "the cameras have OpenCV's axes (y down, z forward)",
                "negate its second and third column",
                lambda m: m @ flip_yz,
            ),
            ("the matrices are world-to-camera, not camera-to-world", "store the inverse", np.linalg.inv),
            (
                "the matrices are world-to-camera with OpenCV's axes",
                "store the inverse, and negate its second and third column",
                lambda m: np.linalg.inv(m) @ flip_yz,
            ),
            (
                "the rotations of the matrices are transposed",
                "transpose the upper left 3 x 3",
                lambda m: np.block([[m[:3, :3].T, m[:3, 3:]], [m[3:]]]),
            ),
            *(
                (
                    f"the {axis} axis of the cameras is mirrored",
                    f"negate its {ordinal} column",
                    lambda m, a=axis: m @ mirror[a],
                )
                for axis, ordinal in zip("xyz", ("first", "second", "third"), strict=True)
            ),
            (
                "the world of the cameras has z up, that of the head y up",
                "rotate it by -90 degrees about x",
                lambda m: z_up @ m,
            ),
            ("the world of the cameras has y down, that of the head y up", "negate its rows 2 and 3",
             lambda m: flip_yz @ m),
        )
    ]  # fmt: skip
    found += [
        Hypothesis("units", "the positions of the cameras are in millimetres", f"{cameras}: divide the last column by "
                   "1000 (except its last entry)", _stored(_metres)),
        Hypothesis("units", "the translations of the head are in millimetres", "translation: divide by 1000",
                   _metre_heads),
        Hypothesis("units", "the positions of the cameras and the translations of the head are in millimetres",
                   f"{cameras}: divide the last column by 1000 (except its last entry); translation: divide by 1000",
                   lambda scene: _metre_heads(_stored(_metres)(scene))),
    ]  # fmt: skip
    found += [
        Hypothesis("intrinsics", "fl_y is negative", "fl_y: write its absolute value",
                   _intrinsics(lambda c: {"fx": abs(c.fx), "fy": abs(c.fy)})),
        Hypothesis("intrinsics", "cy is counted from the bottom of the image", "cy: write h - cy",
                   _intrinsics(lambda c: {"cy": c.height - c.cy})),
        Hypothesis("intrinsics", "fl_y is negative, and cy is counted from the bottom of the image",
                   "fl_y: write its absolute value; cy: write h - cy",
                   _intrinsics(lambda c: {"fy": abs(c.fy), "cy": c.height - c.cy})),
        Hypothesis("intrinsics", "cx is counted from the right of the image", "cx: write w - cx",
                   _intrinsics(lambda c: {"cx": c.width - c.cx})),
        Hypothesis("intrinsics", "cx and cy are exchanged", "exchange them",
                   _intrinsics(lambda c: {"cx": c.cy, "cy": c.cx})),
        Hypothesis("intrinsics", "cx and cy are shares of the image's size", "cx: multiply by w; cy: multiply by h",
                   _intrinsics(lambda c: {"cx": c.cx * c.width, "cy": c.cy * c.height})),
    ]  # fmt: skip
    for share, factor in (("a quarter of", 4.0), ("half", 2.0), ("twice", 0.5), ("four times", 0.25)):
        found.append(
            Hypothesis("intrinsics", f"the intrinsics belong to images of {share} the resolution",
                       f"fl_x, fl_y, cx, cy: multiply by {factor:g}",
                       _intrinsics(partial(_scaled_intrinsics, factor=factor)))
        )  # fmt: skip
    for unit, focal in _focal_units():
        found.append(
            Hypothesis("intrinsics", f"the focal lengths are {unit}", "fl_x, fl_y: write pixels", _intrinsics(focal))
        )
    found += [
        Hypothesis("images", "the images are mirrored", "mirror images and mattes",
                   lambda scene: scene.with_shots(partial(_flipped, axis=1))),
        Hypothesis("images", "the images are upside down", "turn images and mattes over",
                   lambda scene: scene.with_shots(partial(_flipped, axis=0))),
        Hypothesis("images", "the images are turned by 180 degrees", "turn images and mattes",
                   lambda scene: scene.with_shots(lambda shot: _flipped(_flipped(shot, 0), 1))),
        Hypothesis("time", "the head parameters are early by a timestep: those of the next timestep fit",
                   "flame_param_path: name the file of the next timestep", partial(_shifted_time, step=1)),
        Hypothesis("time", "the head parameters are late by a timestep: those of the previous timestep fit",
                   "flame_param_path: name the file of the previous timestep", partial(_shifted_time, step=-1)),
    ]  # fmt: skip
    return found


HYPOTHESES: tuple[Hypothesis, ...] = tuple(_hypotheses())
"""Simple ones first: of two that explain the images equally well, the first is named."""
