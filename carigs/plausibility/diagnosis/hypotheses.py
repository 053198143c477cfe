"""The usual mistakes of a capture, as changes of a scene that undo them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from carigs.capture import OPENCV_FROM_OPENGL, Camera
from carigs.plausibility.diagnosis.scene_changes import (
    MILLIMETRE,
    Change,
    change_intrinsics,
    change_matrices,
    flip_images,
    in_turn,
    scale_intrinsics,
    scale_positions,
    scale_translations,
    shift_time,
)

Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
SENSOR_WIDTH = 36.0
"""Of a film camera, to which focal lengths in millimetres usually refer."""


class Hypothesis(NamedTuple):
    """A mistake."""

    group: str
    """Mistakes of one group exclude each other."""
    mistake: str
    """What is wrong."""
    field: str
    """Where: keys of transforms_*.json, or the array of the head parameters."""
    remedy: str
    """What to do about it."""
    undo: Change
    """From the scene as stated to the supposed one."""
    cameras: frozenset[int] = frozenset()
    """The cameras that it concerns; empty if it concerns all."""


def _axes() -> Iterator[Hypothesis]:
    opencv = "negate the second and the third column"
    for mistake, remedy, change in (
        ("the cameras have OpenCV's axes (y down, z forward)", opencv, lambda m: m @ OPENCV_FROM_OPENGL),
        ("the matrices are world-to-camera, not camera-to-world", "write the inverse", np.linalg.inv),
        (
            "the matrices are world-to-camera with OpenCV's axes",
            f"write the inverse, and {opencv}",
            lambda m: np.linalg.inv(m) @ OPENCV_FROM_OPENGL,
        ),
        (
            "the rotations are transposed",
            "transpose the upper left 3 x 3",
            lambda m: np.block([[m[:3, :3].T, m[:3, 3:]], [m[3:]]]),
        ),
        ("the x axis of the cameras is mirrored", "negate the first column", lambda m: m * [-1, 1, 1, 1]),
        ("the y axis of the cameras is mirrored", "negate the second column", lambda m: m * [1, -1, 1, 1]),
        ("the z axis of the cameras is mirrored", "negate the third column", lambda m: m * [1, 1, -1, 1]),
        ("the world of the cameras has z up, not y", "rotate by -90 degrees about x", lambda m: Y_UP_FROM_Z_UP @ m),
        ("the world of the cameras has y down", "negate rows 2 and 3", lambda m: OPENCV_FROM_OPENGL @ m),
    ):
        yield Hypothesis("axes", mistake, "transform_matrix", remedy, change_matrices(change))


def _units() -> Iterator[Hypothesis]:
    cameras, heads = scale_positions(MILLIMETRE), scale_translations(MILLIMETRE)
    divide = "divide by 1000"
    for what, field, remedy, change in (
        ("the positions of the cameras", "transform_matrix", "divide the positions by 1000", cameras),
        ("the translations of the head", "translation", divide, heads),
        (
            "the positions of the cameras and the translations of the head",
            "transform_matrix, translation",
            "divide the positions and the translations by 1000",
            in_turn(cameras, heads),
        ),
    ):
        yield Hypothesis("units", f"{what} are in millimetres, not metres", field, remedy, change)


def _intrinsics() -> Iterator[Hypothesis]:
    for mistake, field, remedy, change in (
        ("fl_y is negative", "fl_y", "write its absolute value", lambda c: {"fy": abs(c.fy)}),
        ("cy counts from the bottom of the image", "cy", "write h - cy", lambda c: {"cy": c.height - c.cy}),
        (
            "fl_y is negative, and cy counts from the bottom of the image",
            "fl_y, cy",
            "write -fl_y and h - cy",
            lambda c: {"fy": abs(c.fy), "cy": c.height - c.cy},
        ),
        ("cx counts from the right of the image", "cx", "write w - cx", lambda c: {"cx": c.width - c.cx}),
        ("cx and cy are exchanged", "cx, cy", "exchange them", lambda c: {"cx": c.cy, "cy": c.cx}),
        (
            "the principal point is in shares of the image's size, not pixels",
            "cx, cy",
            "multiply by w and h",
            lambda c: {"cx": c.cx * c.width, "cy": c.cy * c.height},
        ),
    ):
        yield Hypothesis("intrinsics", mistake, field, remedy, change_intrinsics(change))
    for resolution, factor in (("half", 2.0), ("twice", 0.5), ("a quarter of", 4.0), ("four times", 0.25)):
        mistake = f"the intrinsics belong to images of {resolution} the resolution"
        remedy = f"multiply by {factor:g}"
        yield Hypothesis("intrinsics", mistake, "fl_x, fl_y, cx, cy", remedy, scale_intrinsics(factor))
    for unit, focal in _focal_units():
        mistake = f"the focal lengths are {unit}, not pixels"
        remedy = "convert them to pixels"
        yield Hypothesis("intrinsics", mistake, "fl_x, fl_y", remedy, change_intrinsics(focal))


def _focal_units() -> Iterator[tuple[str, Callable[[Camera], dict[str, float]]]]:
    """Focal lengths in other units: their names, and how to convert them.

    Of two focal lengths in one unit, each may refer to its own side of the image or both to the same side.
    """

    def shares(x: str, y: str, factor: float) -> Callable[[Camera], dict[str, float]]:
        return lambda c: {"fx": factor * c.fx * getattr(c, x), "fy": factor * c.fy * getattr(c, y)}

    def angles(x: str, y: str, unit: float) -> Callable[[Camera], dict[str, float]]:
        def convert(c: Camera) -> dict[str, float]:
            fields = np.clip([unit * c.fx, unit * c.fy], 1e-3, np.pi - 1e-3)
            fx, fy = [getattr(c, x), getattr(c, y)] / (2 * np.tan(fields / 2))
            return {"fx": float(fx), "fy": float(fy)}

        return convert

    sides = {"width and height": ("width", "height"), "width": ("width", "width"), "height": ("height", "height")}
    for side, keys in sides.items():
        yield f"shares of the image's {side}", shares(*keys, 1)
        yield f"shares of half the image's {side}", shares(*keys, 0.5)
        yield f"fields of view in degrees over the image's {side}", angles(*keys, np.pi / 180)
        yield f"fields of view in radians over the image's {side}", angles(*keys, 1)
    yield f"millimetres on a sensor of {SENSOR_WIDTH:g} mm", shares("width", "width", 1 / SENSOR_WIDTH)


def _files() -> Iterator[Hypothesis]:
    pictures, heads = "file_path, fg_mask_path", "flame_param_path"
    yield Hypothesis("images", "the images are mirrored", pictures, "exchange left and right", flip_images(1))
    yield Hypothesis("images", "the images are upside down", pictures, "turn them over", flip_images(0))
    yield Hypothesis("images", "the images are turned by 180 degrees", pictures, "turn them", flip_images(0, 1))
    for shift, other, step in (("late", "next", 1), ("early", "previous", -1)):
        mistake = f"the head parameters are {shift} by a timestep: those of the {other} one fit"
        yield Hypothesis("time", mistake, heads, f"name the file of the {other} timestep", shift_time(step))


HYPOTHESES: tuple[Hypothesis, ...] = (*_axes(), *_units(), *_intrinsics(), *_files())
"""Of two that explain the images equally well, the first is named."""
