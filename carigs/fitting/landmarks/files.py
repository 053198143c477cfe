"""Files of landmarks: positions in the images.

They are .npz files:

| array | shape | meaning |
|---|---|---|
| `landmarks` | timesteps x cameras x points x 3 | x, y in pixels (pixel centres at +0.5) and confidence from 0 to 1 |
| `timesteps` | timesteps | `timestep_index` of each |
| `cameras` | cameras | `camera_index` of each |

Confidence 0, or NaN, stands for a landmark that was not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz
from carigs.system.files import writing

FARTHEST = 1e6
"""Pixels."""


@dataclass(frozen=True)
class Landmarks:
    """Landmarks of a video."""

    values: Float[np.ndarray, "t c p 3"]
    """x, y, confidence; all 0 where missing."""
    timesteps: Int[np.ndarray, " t"]
    cameras: Int[np.ndarray, " c"]
    source: str = ""
    """The file or folder that they come from, for messages."""

    def save(self, file: Path) -> None:
        """Write the file.

        Args:
            file: .npz file.
        """
        with writing(file) as part:
            np.savez_compressed(part, landmarks=self.values, timesteps=self.timesteps, cameras=self.cameras)

    def at(self, timesteps: Sequence[int], cameras: Sequence[int]) -> Float[np.ndarray, "t c p 3"]:
        """Landmarks of frames.

        Args:
            timesteps: Timesteps.
            cameras: Numbers of cameras.

        Returns:
            x, y, confidence; all 0 for frames without landmarks.
        """
        found = np.zeros((len(timesteps), len(cameras), *self.values.shape[2:]))
        row = {int(t): i for i, t in enumerate(self.timesteps)}
        column = {int(c): i for i, c in enumerate(self.cameras)}
        t = [i for i, timestep in enumerate(timesteps) if timestep in row]
        c = [i for i, camera in enumerate(cameras) if camera in column]
        source = np.ix_([row[timesteps[i]] for i in t], [column[cameras[i]] for i in c])
        found[np.ix_(t, c)] = self.values[source]
        return found


def read_landmarks(file: Path) -> Landmarks:
    """Read landmarks.

    Args:
        file: .npz file as described above.

    Returns:
        The landmarks.

    Raises:
        InputError: If the file is missing, damaged, or holds arrays of other shapes or impossible values.
    """
    arrays = read_npz(file, "landmark file", ["landmarks", "timesteps", "cameras"])
    values = np.asarray(arrays["landmarks"])
    if values.dtype.kind == "f" and values.ndim > 0:  # NaN and infinity mark what was not found
        arrays["landmarks"] = np.where(np.isfinite(values).all(axis=-1, keepdims=True), values, 0)
    values = checked_array(arrays, "landmarks", (None, None, None, 3), np.float64, file=file)
    if (values[..., 2] < 0).any() or (values[..., 2] > 1).any():
        raise InputError("the third column is the confidence, from 0 to 1", file=file, field="landmarks")
    if np.abs(values[..., :2]).max(initial=0) > FARTHEST:
        raise InputError(f"positions beyond {FARTHEST:g} pixels", file=file, field="landmarks")
    numbers = []
    for name, count in (("timesteps", values.shape[0]), ("cameras", values.shape[1])):
        numbers.append(checked_array(arrays, name, (count,), np.int64, file=file))
        if len(np.unique(numbers[-1])) < count:
            raise InputError("a number appears twice", file=file, field=name)
    return Landmarks(np.where(values[..., 2:] > 0, values, 0), *numbers)
