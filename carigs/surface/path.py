"""The family S_gamma as a few exactly solved nodes and a polynomial between them.

The weights |K|^gamma are entire functions of gamma, so the error falls faster than geometrically with the nodes.
"""

from __future__ import annotations

import json
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.errors import InputError, SettingsError
from carigs.files import writing
from carigs.surface.caricature import Caricature
from carigs.surface.mesh import diagonal

if TYPE_CHECKING:
    from carigs.surface.exaggeration import Exaggerator

ARRAYS = ("levels", "displacements", "faces", "neutral")
MOST_NODES = 12


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
        return lagrange_weights(self._barycentric, level)

    @cached_property
    def _barycentric(self) -> list[tuple[float, float]]:
        return barycentric(self.levels)

    @cached_property
    def _moved(self) -> Float32[np.ndarray, "j w"]:
        """The nodes but level 0, where nothing moves, in one block."""
        return np.ascontiguousarray(self.displacements[1:].reshape(len(self.levels) - 1, -1))

    def displacement(self, level: float) -> Float32[np.ndarray, "v 3"]:
        """The offset from the neutral at a level; exactly zero at level 0.  Warns outside [0, gamma_f]."""
        if not 0 <= level * self._sign <= self.gamma_f * self._sign:
            # The level is left out of the text: Python shows a text once, and a film has many levels.
            warnings.warn(f"levels outside [0, {self.gamma_f:g}] are extrapolated", stacklevel=2)
        return (self.weights(level)[1:].astype(np.float32) @ self._moved).reshape(-1, 3)

    @cached_property
    def _sign(self) -> float:
        return float(np.sign(self.gamma_f))

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


class Solvable(Protocol):
    """A head, or a region of one: what `solved_path` interpolates."""

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """w per face."""

    def response(self, strain: Float[np.ndarray, " f"]) -> Float[np.ndarray, "v 3"]:
        """The displacement that weights of 1 + strain cause."""

    def solve(self, level: float) -> Float[np.ndarray, "v 3"]:
        """`response` to the weights of a level, with all that follows."""


def solved_path(what: Solvable, gamma_f: float, solver: Exaggerator) -> GammaPath:
    """Exact solves at the Chebyshev-Lobatto levels from 0 to gamma_f: `nodes` of the settings, or as many as needed.

    The interpolation's error at a level is itself the response to the error of the interpolated weights.  So before
    anything is solved, their number is raised until the response to the largest one is below `path_error`.
    """
    if not (gamma_f != 0 and np.isfinite(gamma_f)):
        raise SettingsError(f"gamma={gamma_f:g}: a path needs a level other than 0")
    settings = solver.settings
    count, error = settings.nodes, None
    if count == 0:
        extent = diagonal(solver.vertices)
        for count in range(2, MOST_NODES + 1):
            error = _error(what, lobatto_levels(count, gamma_f), solver.face_areas) / extent
            if error <= settings.path_error:
                break
    levels = lobatto_levels(count, gamma_f)
    displacements = np.stack([what.solve(float(level)) for level in levels]).astype(np.float32)
    report = {
        "source": "poisson",
        "settings": json.loads(json.dumps(asdict(settings))),
        **solver.report,
        "nodes": count,
        "path_error": error,
        "largest_displacement": float(np.abs(displacements[-1]).max()),
    }
    return GammaPath(levels, displacements, solver.faces, solver.vertices, report)


def _error(what: Solvable, levels: Float[np.ndarray, "k"], areas: Float[np.ndarray, " f"]) -> float:
    """The largest displacement between interpolation and solution, midway between the two nodes where it is worst."""
    nodes, formula = np.stack([what.weights(level) for level in levels]), barycentric(levels)
    middles = (levels[1:] + levels[:-1]) / 2
    errors = [lagrange_weights(formula, middle) @ nodes - what.weights(middle) for middle in middles]
    worst = max(errors, key=lambda error: areas @ error**2)
    return float(np.linalg.norm(what.response(worst), axis=1).max())


def lobatto_levels(count: int, gamma_f: float) -> Float[np.ndarray, "k"]:
    """The extrema of Chebyshev's polynomial between 0 and gamma_f, both included."""
    return gamma_f * (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2


def barycentric(levels: Float[np.ndarray, "k"]) -> list[tuple[float, float]]:
    """Nodes and their weights 1 / prod(x_j - x_k)."""
    differences = levels[:, None] - levels[None, :]
    np.fill_diagonal(differences, 1.0)
    return list(zip(levels.tolist(), (1.0 / differences.prod(axis=1)).tolist(), strict=True))


def lagrange_weights(formula: list[tuple[float, float]], level: float) -> Float[np.ndarray, "k"]:
    """Share of each node at a level (Berrut and Trefethen 2004, equation 4.2)."""
    # A handful of numbers: NumPy would take longer to be called than Python to compute.
    offsets = [float(level) - node for node, _ in formula]
    if 0.0 in offsets:
        return np.eye(len(offsets))[offsets.index(0.0)]
    terms = [weight / offset for (_, weight), offset in zip(formula, offsets, strict=True)]
    total = sum(terms)
    return np.array([term / total for term in terms])
