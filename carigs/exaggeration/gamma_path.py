"""The family S_gamma as a few exactly solved nodes and a polynomial between them."""

from __future__ import annotations

import json
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.errors import InputError, SettingsError
from carigs.exaggeration.caricature import Caricature
from carigs.exaggeration.lobatto_interpolation import barycentric, lagrange_weights
from carigs.files import writing

ARRAYS = ("levels", "displacements", "faces", "neutral")


@dataclass(frozen=True)
class GammaPath:
    """Displacements of the neutral head at a few levels, in metres; exact at those, interpolated between."""

    levels: Float[np.ndarray, "k"]
    """From 0 to gamma_f, which may be below 0."""
    displacements: Float32[np.ndarray, "k v 3"]
    faces: Int[np.ndarray, "f 3"]
    neutral: Float[np.ndarray, "v 3"]
    report: dict[str, Any] = field(default_factory=dict)
    """How the nodes were made: JSON-able."""
    columns: Int[np.ndarray, " b"] | None = None
    """Codes whose motions change, as in `Caricature`; None: no motion does."""
    changes: Float32[np.ndarray, "n b v 3"] | None = None
    """What the levels above 0 add to the motions of those."""

    @property
    def gamma_f(self) -> float:
        """The level that the path was made for."""
        return float(self.levels[-1])

    def weights(self, level: float) -> Float[np.ndarray, "k"]:
        """Lagrange weights of the nodes at a level, by the barycentric formula (Berrut and Trefethen 2004, eq. 4.2)."""
        return np.array(lagrange_weights(self._barycentric, level))

    @cached_property
    def _barycentric(self) -> list[tuple[float, float]]:
        return barycentric(self.levels)

    @cached_property
    def _moved(self) -> Float32[np.ndarray, "j w"]:
        """The nodes but level 0, where nothing moves, in one block."""
        return np.ascontiguousarray(self.displacements[1:].reshape(len(self.levels) - 1, -1))

    def displacement(self, level: float) -> Float32[np.ndarray, "v 3"]:
        """The offset from the neutral at a level; exactly zero at level 0.  Warns outside [0, gamma_f]."""
        if not self._span[0] <= level <= self._span[1]:
            # The level is left out of the text: Python shows a text once, and a film has many levels.
            warnings.warn(f"levels outside [0, {self.gamma_f:g}] are extrapolated", stacklevel=2)
        shares = np.array(lagrange_weights(self._barycentric, level)[1:], np.float32)
        # NumPy hands a product with a single row to BLAS in the shape that it is slowest in.
        moved = shares[0] * self._moved[0] if len(shares) == 1 else shares @ self._moved
        return moved.reshape(-1, 3)

    @cached_property
    def _span(self) -> tuple[float, float]:
        return min(0.0, self.gamma_f), max(0.0, self.gamma_f)

    def at(self, level: float) -> Caricature:
        """What a level adds to the head and its motions; exactly nothing at level 0.  Warns as `displacement`."""
        if self.changes is None:
            return Caricature(self.displacement(level))
        changes = self.weights(level)[1:].astype(np.float32) @ self.changes.reshape(len(self.changes), -1)
        return Caricature(self.displacement(level), self.columns, changes.reshape(self.changes.shape[1:]))

    def save(self, file: str | Path) -> None:
        """Write an .npz that `load` reads."""
        motions = {} if self.changes is None else {"columns": self.columns, "changes": self.changes}
        with writing(file) as part:
            np.savez(
                part,
                levels=self.levels,
                displacements=self.displacements,
                faces=self.faces,
                neutral=self.neutral,
                report=json.dumps(self.report),
                **motions,
            )

    @classmethod
    def load(cls, file: str | Path) -> GammaPath:
        """Raises `InputError` naming file and field for a missing or broken path."""
        arrays = _read(file)
        levels, displacements, faces, neutral = (
            arrays[name] for name in ("levels", "displacements", "faces", "neutral")
        )

        def refuse(bad: bool, field: str, problem: str) -> None:
            if bad:
                raise InputError(problem, file=file, field=field)

        refuse(neutral.ndim != 2 or neutral.shape[1] != 3, "neutral", f"shape {neutral.shape}, expected (v, 3)")
        refuse(faces.ndim != 2 or faces.shape[1] != 3, "faces", f"shape {faces.shape}, expected (f, 3)")
        refuse(levels.ndim != 1 or len(levels) < 2, "levels", f"shape {levels.shape}, expected two or more levels")
        expected = (len(levels), *neutral.shape)
        refuse(displacements.shape != expected, "displacements", f"shape {displacements.shape}, expected {expected}")
        for name in ("levels", "displacements", "neutral"):
            array = arrays[name]
            refuse(array.dtype.kind != "f", name, f"holds {array.dtype}, expected floating-point numbers")
            refuse(not np.isfinite(array).all(), name, "holds values that are not finite")
        refuse(faces.dtype.kind not in "iu", "faces", f"holds {faces.dtype}, expected vertex numbers")
        outside = faces.size > 0 and (faces.min() < 0 or faces.max() >= len(neutral))
        refuse(outside, "faces", f"vertex numbers must lie in 0..{len(neutral) - 1}")
        one_way = (np.diff(levels) > 0).all() or (np.diff(levels) < 0).all()
        refuse(levels[0] != 0 or not one_way, "levels", "expected ascending (or descending) levels from 0")
        refuse(bool(displacements[0].any()), "displacements", "level 0 must not move anything")
        columns, changes = arrays.get("columns"), arrays.get("changes")
        if changes is not None:
            expected = (len(levels) - 1, *np.shape(columns), *neutral.shape)
            refuse(changes.shape != expected, "changes", f"shape {changes.shape}, expected {expected}")
            refuse(columns is None or columns.dtype.kind not in "iu", "columns", "expected the numbers of the codes")
            refuse(changes.dtype.kind != "f", "changes", f"holds {changes.dtype}, expected floating-point numbers")
            refuse(not np.isfinite(changes).all(), "changes", "holds values that are not finite")
        try:
            report = json.loads(str(arrays["report"]))
        except ValueError as error:
            raise InputError(f"is not JSON ({error})", file=file, field="report") from error
        nodes = levels.astype(np.float64), displacements.astype(np.float32)
        return cls(*nodes, faces, neutral.astype(np.float64), report, columns, changes)


def _read(file: str | Path) -> dict[str, np.ndarray]:
    try:
        with Path(file).open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise InputError("no such path", file=file) from error
    except (OSError, ValueError, EOFError, TypeError, BadZipFile, zlib.error) as error:
        raise InputError(f"not a readable .npz ({error})", file=file) from error
    for name in (*ARRAYS, "report"):
        if name not in arrays:
            raise InputError("this array is missing", file=file, field=name)
    return arrays


def straight_path(
    neutral: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    displacement: Float[np.ndarray, "v 3"],
    gamma_f: float,
) -> GammaPath:
    """The straight path to a given caricature (an artist's sculpt), which stands for level gamma_f."""
    nodes = np.stack([np.zeros_like(displacement), displacement]).astype(np.float32)
    return GammaPath(np.array([0.0, gamma_f]), nodes, faces, neutral, {"source": "file"})


@dataclass(frozen=True)
class RegionPaths:
    """A path for each region of a head, all held by the rest: sliders that know nothing of each other and add up."""

    paths: Mapping[str, GammaPath]

    def displacement(self, levels: Mapping[str, float]) -> Float32[np.ndarray, "v 3"]:
        """The offset from the neutral with regions at their levels; raises `SettingsError` for unknown names."""
        for name in levels:
            if name not in self.paths:
                raise SettingsError(f"no slider {name}; known: {', '.join(sorted(self.paths))}")
        still = np.zeros_like(next(iter(self.paths.values())).displacements[0])
        return sum((self.paths[name].displacement(level) for name, level in levels.items()), start=still)
