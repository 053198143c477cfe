"""Cameras that cannot exist are refused: no rotation, no focal length, a principal point outside the image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera
from carigs.errors import InputError

TOLERANCE = 1e-3
"""Of the entries of R^T R - I: matrices written with four decimals pass."""
FARTHEST = 1e4
"""Metres of a camera from the origin of the world."""
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

    def refuse(problem: str) -> None:
        raise InputError(f"expected a 4 x 4 rigid transform: {problem}", file=file, field=field)

    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > TOLERANCE:
        refuse(f"the last row is {' '.join(f'{x:g}' for x in matrix[3])}, not 0 0 0 1")
    rotation = matrix[:3, :3]
    if not np.abs(rotation).max() < 1 + TOLERANCE or np.abs(rotation.T @ rotation - np.eye(3)).max() > TOLERANCE:
        lengths = " ".join(f"{x:.4g}" for x in np.linalg.norm(np.clip(rotation, -1e100, 1e100), axis=0))
        refuse(f"its upper left 3 x 3 is no rotation (columns of length {lengths})")
    if np.abs(matrix[:3, 3]).max() > FARTHEST:
        refuse(f"the camera is {np.abs(matrix[:3, 3]).max():.3g} m from the origin; metres are expected")
    if np.linalg.det(rotation) < 0:
        refuse("its upper left 3 x 3 mirrors the world (determinant -1); negate one axis")


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
            raise InputError(f"a focal length must be positive, found {focal:g}", file=file, field=f"{where}.{key}")
        degrees = 2 * np.degrees(np.arctan(size / (2 * focal)))
        if not FIELD_OF_VIEW[0] < degrees < FIELD_OF_VIEW[1]:
            problem = f"{focal:g} pixels are a field of view of {degrees:.3g} degrees for an image of {size} pixels"
            raise InputError(f"{problem}; focal lengths are in pixels", file=file, field=f"{where}.{key}")
    if max(camera.cx, camera.cy) <= 1 < min(camera.width, camera.height) and min(camera.cx, camera.cy) > 0:
        problem = f"({camera.cx:g}, {camera.cy:g}) looks like shares of the image's size; pixels are expected"
        raise InputError(problem, file=file, field=f"{where}.cx, cy")
    for key, centre, size in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if not 0 <= centre <= size:
            problem = f"the principal point {centre:g} lies outside the image of {size} pixels"
            raise InputError(problem, file=file, field=f"{where}.{key}")
