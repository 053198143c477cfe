"""Cameras that cannot exist are refused: no rotation, no focal length, a principal point outside the image."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera
from carigs.errors import InputError

TOLERANCE = 1e-3
"""Of the entries of R^T R - I: matrices written with four decimals pass."""
FARTHEST = 1e4
"""Metres of a camera from the origin of the world."""
EDGE = 1.0
"""Pixels at the edge of an image by which a focal length and a field of view may differ: programs that scale images
round their sizes."""
FIELD_OF_VIEW = (0.1, 170.0)
"""Degrees. A pinhole camera cannot see 180 degrees; 0.1 degrees show a head only from a distance of 100 m."""


def check_rigid(matrix: Float[np.ndarray, "4 4"], file: Path, field: str) -> None:
    """Refuse a camera-to-world matrix that is not a rotation and a translation.

    Args:
        matrix: The matrix.
        file: Where it comes from, for messages.
        field: Its field, for messages.

    Raises:
        InputError: If the last row is not 0 0 0 1, the rotation is scaled, skewed or mirrored, or the
            camera is farther away than `FARTHEST`.
    """

    def refuse(problem: str, remedy: str) -> None:
        raise InputError(f"expected a 4 x 4 rigid transform: {problem}", file=file, field=field, remedy=remedy)

    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > TOLERANCE:
        remedy = "write 0 0 0 1 as the last row; a matrix whose last row holds a position is transposed"
        refuse(f"the last row is {' '.join(f'{x:g}' for x in matrix[3])}, not 0 0 0 1", remedy)
    rotation = matrix[:3, :3]
    if not np.abs(rotation).max() < 1 + TOLERANCE or np.abs(rotation.T @ rotation - np.eye(3)).max() > TOLERANCE:
        lengths = " ".join(f"{x:.4g}" for x in np.linalg.norm(np.clip(rotation, -1e100, 1e100), axis=0))
        remedy = "write columns of length 1; a scale belongs into the positions"
        refuse(f"its upper left 3 x 3 is no rotation (columns of length {lengths})", remedy)
    if np.abs(matrix[:3, 3]).max() > FARTHEST:
        remedy = "divide the positions by 1000 if they are in millimetres"
        refuse(f"the camera is {np.abs(matrix[:3, 3]).max():.3g} m from the origin; metres are expected", remedy)
    if np.linalg.det(rotation) < 0:
        remedy = "negate the column of the axis that points the wrong way: axes are x right, y up, z backward"
        refuse("its upper left 3 x 3 mirrors the world (determinant -1); negate one axis", remedy)


def check_field_of_view(focal: float, angle: float, size: int, field: str, file: Path) -> None:
    """Refuse a focal length and a field of view that put the corners of an image into different places.

    Args:
        focal: Focal length in pixels.
        angle: Field of view in radians.
        size: Width or height of the image in pixels, along the field of view.
        field: The field of the angle, for messages.
        file: Where they come from, for messages.

    Raises:
        InputError: If the edge of the image differs by more than `EDGE`.
    """
    by_angle = size / (2 * math.tan(angle / 2 or math.nan))
    if not abs(focal / by_angle - 1) * size / 2 <= EDGE:
        problem = f"{angle:.5g} rad is a focal length of {by_angle:.6g} pixels, stated are {focal:.6g}"
        raise InputError(problem, file=file, field=field, remedy="remove the wrong one of the two")


def check_intrinsics(camera: Camera, file: Path, where: str) -> None:
    """Refuse intrinsics that no camera has.

    Args:
        camera: The camera.
        file: Where it comes from, for messages.
        where: Its position in the file, for messages.

    Raises:
        InputError: If a size or focal length is not positive, the field of view is beyond `FIELD_OF_VIEW`, or the
            principal point lies outside the image or is normalised to its size.
    """
    if camera.width == 0 or camera.height == 0:
        raise InputError(f"{camera.width} x {camera.height} pixels", file=file, field=f"{where}.w, h")
    for key, focal, size in (("fl_x", camera.fx, camera.width), ("fl_y", camera.fy, camera.height)):
        if focal <= 0:
            problem = f"a focal length must be positive, found {focal:g}"
            raise InputError(problem, file=file, field=f"{where}.{key}", remedy="write the absolute value")
        degrees = 2 * np.degrees(np.arctan(size / (2 * focal)))
        if not FIELD_OF_VIEW[0] < degrees < FIELD_OF_VIEW[1]:
            problem = f"{focal:g} pixels are a field of view of {degrees:.3g} degrees for an image of {size} pixels"
            remedy = "write pixels: w / (2 tan(fov_x / 2)), or multiply a share of the width by w"
            problem = f"{problem}; focal lengths are in pixels"
            raise InputError(problem, file=file, field=f"{where}.{key}", remedy=remedy)
    if max(camera.cx, camera.cy) <= 1 < min(camera.width, camera.height) and min(camera.cx, camera.cy) > 0:
        problem = f"({camera.cx:g}, {camera.cy:g}) looks like shares of the image's size; pixels are expected"
        remedy = "multiply cx by w and cy by h"
        raise InputError(problem, file=file, field=f"{where}.cx, cy", remedy=remedy)
    for key, centre, size in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if not 0 <= centre <= size:
            problem = f"the principal point {centre:g} lies outside the image of {size} pixels"
            remedy = "cx and cy are pixels of images of the size w x h: scale them to that size"
            raise InputError(problem, file=file, field=f"{where}.{key}", remedy=remedy)
