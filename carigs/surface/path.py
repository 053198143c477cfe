"""The family S_gamma as a few exactly solved nodes and a polynomial between them."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.errors import InputError
from carigs.files import writing


@dataclass(frozen=True)
class GammaPath:
    """Displacements of the neutral head at a few levels, in metres; exact at those, interpolated between."""

    levels: Float[np.ndarray, "k"]
    """Ascending, from 0 to gamma_f."""
    displacements: Float32[np.ndarray, "k v 3"]
    faces: Int[np.ndarray, "f 3"]
    neutral: Float[np.ndarray, "v 3"]
    report: dict[str, Any] = field(default_factory=dict)
    """How the nodes were made: JSON-able."""

    @property
    def gamma_f(self) -> float:
        """The level that the path was made for."""
        return float(self.levels[-1])

    def weights(self, level: float) -> Float[np.ndarray, "k"]:
        """Lagrange weights of the nodes at a level, by the barycentric formula (Berrut and Trefethen 2004, eq. 4.2)."""
        offsets = level - self.levels
        if (at := np.flatnonzero(offsets == 0)).size:
            return np.eye(len(self.levels))[at[0]]
        differences = self.levels[:, None] - self.levels[None, :]
        np.fill_diagonal(differences, 1.0)
        terms = 1.0 / (differences.prod(axis=1) * offsets)
        return terms / terms.sum()

    def displacement(self, level: float) -> Float[np.ndarray, "v 3"]:
        """The offset from the neutral at a level; exactly zero at level 0.  Warns outside [0, gamma_f]."""
        if not 0 <= level <= self.gamma_f:
            warnings.warn(f"level {level:g} is outside [0, {self.gamma_f:g}], the range that was solved", stacklevel=2)
        return np.tensordot(self.weights(level), self.displacements.astype(np.float64), axes=1)

    def save(self, file: str | Path) -> None:
        """Write an .npz that `load` reads."""
        with writing(file) as part:
            np.savez(
                part,
                levels=self.levels,
                displacements=self.displacements,
                faces=self.faces,
                neutral=self.neutral,
                report=json.dumps(self.report),
            )

    @classmethod
    def load(cls, file: str | Path) -> GammaPath:
        """Raises `InputError` naming file and field for a missing or broken path."""
        try:
            with np.load(file, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        except FileNotFoundError as error:
            raise InputError("no such path", file=file) from error
        except (OSError, ValueError, EOFError) as error:
            raise InputError(f"not a readable .npz ({error})", file=file) from error
        for name in ("levels", "displacements", "faces", "neutral", "report"):
            if name not in arrays:
                raise InputError("this array is missing", file=file, field=name)
        levels, displacements, neutral = arrays["levels"], arrays["displacements"], arrays["neutral"]
        if displacements.shape != (len(levels), *neutral.shape) or neutral.shape[1:] != (3,):
            raise InputError(
                f"shape {displacements.shape} fits neither levels nor neutral", file=file, field="displacements"
            )
        if not np.isfinite(displacements).all():
            raise InputError("holds values that are not finite", file=file, field="displacements")
        if len(levels) < 2 or levels[0] != 0 or (np.diff(levels) <= 0).any():
            raise InputError("expected two or more ascending levels from 0", file=file, field="levels")
        return cls(levels, displacements, arrays["faces"], neutral, json.loads(str(arrays["report"])))


def straight_path(
    neutral: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    displacement: Float[np.ndarray, "v 3"],
    gamma_f: float,
) -> GammaPath:
    """The straight path to a given caricature (an artist's sculpt), which stands for level gamma_f."""
    nodes = np.stack([np.zeros_like(displacement), displacement]).astype(np.float32)
    return GammaPath(np.array([0.0, gamma_f]), nodes, faces, neutral, {"source": "file"})
