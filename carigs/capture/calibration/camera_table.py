"""The distinct cameras of a dataset: each is checked and stored once, however many frames it has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from carigs.capture.calibration.camera_checks import check_intrinsics, check_rigid
from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera
from carigs.errors import InputError, collecting
from carigs.readers.arrays import checked_array

Intrinsics = tuple[float, float, float, float, int, int]
"""fx, fy, cx, cy, width, height in pixels."""
MAX_CONDITION = 1e8
"""Of matrices that are inverted although they are no rigid transforms."""
DECIMALS = 6
"""Transforms that agree to a micrometre are one."""


class CameraTable:
    """Distinct cameras, numbered in the order of their first frames."""

    def __init__(self, errors: list[InputError] | None = None) -> None:
        """Start an empty table.

        Args:
            errors: Receives what is impossible about a camera, which is added all the same, for `carigs check` tries
                what mends it; None to refuse such cameras.
        """
        self._errors = errors
        self.cameras: list[Camera] = []
        self.poses: list[int] = []
        """Number of the pose of each camera: cameras that differ in their intrinsics alone share one."""
        self.impossible: set[int] = set()
        """Numbers of the poses that `errors` has received something about."""
        self._numbers: dict[Any, int] = {}
        self._poses: dict[bytes, int] = {}

    def number(self, matrix: list[Any], intrinsics: Intrinsics, file: Path, where: str) -> int:
        """Number of a camera; a new one is checked and added.

        Args:
            matrix: Rows of the OpenGL camera-to-world transform in metres, as in the file.
            intrinsics: Intrinsics.
            file: Where they come from, for messages.
            where: Position in the file, for messages.

        Returns:
            Position in `cameras`.

        Raises:
            InputError: If no camera has this transform or these intrinsics.
        """
        try:
            key = (*map(tuple, matrix), *intrinsics)
            if key in self._numbers:
                return self._numbers[key]
        except TypeError:  # no rows of numbers: refused below
            key = None
        field = f"{where}.transform_matrix"
        world_from_opengl = checked_array({field: matrix}, field, (4, 4), np.float64, file=file)
        num_errors = len(self._errors or ())
        is_invertible = np.linalg.cond(world_from_opengl) < MAX_CONDITION
        with collecting(self._errors if is_invertible else None):
            check_rigid(world_from_opengl, file, field)
        camera = Camera(OPENCV_FROM_OPENGL @ np.linalg.inv(world_from_opengl), *intrinsics)
        with collecting(self._errors if min(map(abs, intrinsics)) > 0 else None):
            check_intrinsics(camera, file, where)
        rounded = (_rounded(camera.camera_from_world), *intrinsics)
        number = self._numbers.setdefault(rounded, len(self.cameras))
        if number == len(self.cameras):
            self.cameras.append(camera)
            self.poses.append(self._poses.setdefault(rounded[0], len(self._poses)))
            if len(self._errors or ()) > num_errors:
                self.impossible.add(self.poses[-1])
        self._numbers[key] = number
        return number


def _rounded(matrix: Float[np.ndarray, "4 4"]) -> bytes:
    return (np.round(matrix, DECIMALS) + 0.0).tobytes()  # + 0: -0 is 0
