"""The family S_gamma as a few nodes, exactly solved levels, and a polynomial through them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int, Shaped

from carigs.errors import InputError
from carigs.readers.arrays import checked_array, checked_text
from carigs.readers.formats import Format, check_npz_format
from carigs.readers.json_files import parse_json
from carigs.readers.npz import read_npz
from carigs.system.files import writing

FORMAT = Format("carigs-path", 1, "run the stage exaggerate again, as carigs run does")
MAX_STORED_NODES = 100
"""Of a path in a file: the time for its weights grows with the square of their number."""


def lobatto_levels(count: int, gamma_f: float) -> Float[np.ndarray, " k"]:
    """Chebyshev-Lobatto nodes between 0 and gamma_f: gamma_f (1 - cos(pi k / (count - 1))) / 2.

    Args:
        count: Number of nodes, at least 2.
        gamma_f: The last node.

    Returns:
        The nodes, the first of which is 0.
    """
    return gamma_f * (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2


def barycentric_weights(nodes: Float[np.ndarray, " k"]) -> list[tuple[float, float]]:
    """Barycentric weights of polynomial interpolation: 1 / prod_k (x_j - x_k) (Berrut and Trefethen 2004, eq. 3.2).

    Args:
        nodes: Distinct nodes x.

    Returns:
        Pairs of node and weight.
    """
    differences = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(differences, 1.0)
    return list(zip(nodes.tolist(), (1.0 / differences.prod(axis=1)).tolist(), strict=True))


def lagrange_weights(nodes: list[tuple[float, float]], level: float) -> list[float]:
    """Lagrange weights of the nodes at a level, by the barycentric formula (Berrut and Trefethen 2004, eq. 4.2).

    Args:
        nodes: Pairs of node and weight from `barycentric_weights`.
        level: Where to interpolate.

    Returns:
        Weight of each node; they sum to 1.
    """
    # There are only a few numbers, for which plain Python is faster than NumPy.
    level = float(level)
    for node, _ in nodes:
        if node == level:
            return [float(other == level) for other, _ in nodes]
    terms = [weight / (level - node) for node, weight in nodes]
    total = sum(terms)
    return [term / total for term in terms]


@dataclass(frozen=True)
class Caricature:
    """Change of a head at one level: of its neutral, and of its blendshapes and pose correctives."""

    displacement: Float[np.ndarray, "v 3"]
    """Displacement of the neutral, in metres."""
    columns: Int[np.ndarray, " b"] | None = None
    """Indices of the blendshapes that change: expressions are counted first, then pose correctives. None: no change."""
    changes: Float[np.ndarray, "b v 3"] | None = None
    """Change of each of these blendshapes, in metres per unit of its coefficient."""

    def blendshape_change(self, coefficients: Float[np.ndarray, " c"], first: int = 0) -> Float[np.ndarray, "v 3"]:
        """Change of the sum of blendshapes.

        Args:
            coefficients: Coefficients of consecutive blendshapes.
            first: Index of the first of them, in the count of `columns`.

        Returns:
            Offset to add to the sum of the natural blendshapes, in metres.
        """
        if self.columns is None:
            return np.zeros_like(self.displacement)
        column = self.columns - first
        selected = np.flatnonzero((column >= 0) & (column < len(coefficients)))
        selected = selected[coefficients[column[selected]] != 0]
        return np.tensordot(coefficients[column[selected]], self.changes[selected], axes=1)


@dataclass(frozen=True)
class GammaPath:
    """Displacements of the neutral head at a few levels, in metres: exact there, interpolated in between.

    Two nodes give the paper's linear blend (equation 7):

        S_blend(gamma) = (1 - alpha) S_0 + alpha S_gamma_f,    alpha = gamma / gamma_f.

    More nodes give the polynomial S_gamma = sum_i l_i(gamma) S_gamma_i with the Lagrange weights l_i.
    """

    levels: Float[np.ndarray, " k"]
    """The nodes, from 0 to gamma_f, which may be negative."""
    displacements: Float32[np.ndarray, "k v 3"]
    faces: Int[np.ndarray, "f 3"]
    neutral: Float[np.ndarray, "v 3"]
    report: dict[str, Any] = field(default_factory=dict)
    """How the nodes were made, as JSON types."""
    columns: Int[np.ndarray, " b"] | None = None
    """Indices of the blendshapes that change, as in `Caricature`; None: no change."""
    changes: Float32[np.ndarray, "n b v 3"] | None = None
    """Change of these blendshapes at the nodes other than 0, in metres per unit of the coefficient."""

    @property
    def gamma_f(self) -> float:
        """The level that the path was made for."""
        return float(self.levels[-1])

    def weights(self, level: float) -> Float[np.ndarray, " k"]:
        """Lagrange weights of the nodes at a level.

        Args:
            level: Exaggeration gamma.

        Returns:
            Weight of each node.
        """
        return np.array(lagrange_weights(self._nodes, level))

    def displacement(self, level: float) -> Float32[np.ndarray, "v 3"]:
        """Displacement of the neutral at a level; with two nodes the linear blend (paper, equation 7).

        Args:
            level: Exaggeration gamma; a warning is issued outside [0, gamma_f].

        Returns:
            Displacement in metres; exactly 0 at level 0.
        """
        if not min(0.0, self.gamma_f) <= level <= max(0.0, self.gamma_f):
            # The text does not name the level: Python shows a text once, and a film has many levels.
            warnings.warn(f"levels outside [0, {self.gamma_f:g}] are extrapolated", stacklevel=2)
        weights = np.array(lagrange_weights(self._nodes, level)[1:], np.float32)
        # NumPy hands a product with a single row to BLAS in its slowest shape.
        moved = weights[0] * self._flat[0] if len(weights) == 1 else weights @ self._flat
        return moved.reshape(-1, 3)

    def at(self, level: float) -> Caricature:
        """Change of the head and of its blendshapes at a level.

        Args:
            level: Exaggeration gamma; a warning is issued outside [0, gamma_f].

        Returns:
            The change; exactly 0 at level 0.
        """
        if self.changes is None:
            return Caricature(self.displacement(level))
        changes = self.weights(level)[1:].astype(np.float32) @ self.changes.reshape(len(self.changes), -1)
        return Caricature(self.displacement(level), self.columns, changes.reshape(self.changes.shape[1:]))

    @property
    def is_still(self) -> bool:
        """Whether nothing moves at any level, as in `still`."""
        return self.changes is None and not self.displacements.any()

    def still(self) -> GammaPath:
        """The path on which nothing moves, for the same levels.

        Returns:
            The path, with two nodes.
        """
        ends = np.array([0.0, self.gamma_f])
        return GammaPath(ends, np.zeros((2, *self.neutral.shape), np.float32), self.faces, self.neutral)

    @cached_property
    def _nodes(self) -> list[tuple[float, float]]:
        return barycentric_weights(self.levels)

    @cached_property
    def _flat(self) -> Float32[np.ndarray, "j w"]:
        """The nodes other than level 0, where nothing moves, one per row."""
        return np.ascontiguousarray(self.displacements[1:].reshape(len(self.levels) - 1, -1))

    def save(self, file: str | Path) -> None:
        """Write the path as .npz.

        Args:
            file: File to create or replace.
        """
        arrays = {"format": str(FORMAT)} | {entry.name: getattr(self, entry.name) for entry in fields(self)}
        arrays["report"] = json.dumps(self.report)
        with writing(file) as part:
            np.savez(part, **{name: array for name, array in arrays.items() if array is not None})

    @classmethod
    def load(cls, file: str | Path) -> GammaPath:
        """Read and check a path that `save` wrote.

        Args:
            file: The .npz file.

        Returns:
            The path.

        Raises:
            InputError: If the file is missing or broken, or an array is missing or not valid; names the array.
        """
        arrays = read_npz(file, "path")
        check_npz_format(arrays, FORMAT, file, unstated="carigs-path-1")
        path = cls.from_arrays(arrays, checked_array(arrays, "faces", (None, 3), file=file), file)
        return replace(path, report=parse_json(checked_text(arrays, "report", file=file), file, "report"))

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, np.ndarray], faces: Shaped[np.ndarray, "f 3"], file: str | Path, prefix: str = ""
    ) -> GammaPath:
        """Check the arrays of a path.

        Args:
            arrays: Arrays by the names of the fields.
            faces: Vertex indices of the triangles.
            file: Where they come from, for messages.
            prefix: What precedes the names.

        Returns:
            The path, without a report.

        Raises:
            InputError: If an array is missing or not valid; names the array.
        """

        def refuse(is_bad: bool, field: str, problem: str) -> None:
            if is_bad:
                raise InputError(problem, file=file, field=f"{prefix}{field}")

        def take(name: str, *shape: int | None, dtype: type | None = None, kinds: str = "f") -> np.ndarray:
            array = checked_array(arrays, f"{prefix}{name}", shape, file=file)
            expected = "floating-point numbers" if kinds == "f" else "integers"
            refuse(array.dtype.kind not in kinds, name, f"holds {array.dtype}, expected {expected}")
            return array if dtype is None else checked_array(arrays, f"{prefix}{name}", shape, dtype, file=file)

        neutral, levels = take("neutral", None, 3, dtype=np.float64), take("levels", None, dtype=np.float64)
        possible = 2 <= len(levels) <= MAX_STORED_NODES
        refuse(not possible, "levels", f"shape {levels.shape}, expected 2 to {MAX_STORED_NODES} levels")
        displacements = take("displacements", len(levels), *neutral.shape, dtype=np.float32)
        refuse(faces.dtype.kind not in "iu", "faces", f"holds {faces.dtype}, expected integers")
        outside = faces.size > 0 and (faces.min() < 0 or faces.max() >= len(neutral))
        refuse(outside, "faces", f"vertex numbers must lie in 0..{len(neutral) - 1}")
        steps = np.diff(levels)
        is_monotonic = (steps > 0).all() or (steps < 0).all()
        refuse(levels[0] != 0 or not is_monotonic, "levels", "expected ascending (or descending) levels from 0")
        inside = 1e-6 < np.abs(levels[-1]) <= 100 and np.abs(steps).min() > 1e-5 * np.abs(levels[-1])
        refuse(not inside, "levels", "levels up to 100 are expected, further apart")
        refuse(bool(displacements[0].any()), "displacements", "level 0 must not move anything")
        columns = changes = None
        if f"{prefix}changes" in arrays:
            columns = take("columns", None, kinds="iu")
            refuse(bool((columns.astype(np.float64) < 0).any()), "columns", "indices must not be negative")
            refuse(len(np.unique(columns)) < len(columns), "columns", "an index appears twice")
            changes = take("changes", len(levels) - 1, len(columns), *neutral.shape, dtype=np.float32)
        return cls(levels, displacements, faces, neutral, {}, columns, changes)


def straight_path(
    neutral: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    displacement: Float[np.ndarray, "v 3"],
    gamma_f: float,
) -> GammaPath:
    """Make the linear path to a given caricature, such as an artist's sculpture.

    Args:
        neutral: Positions of the neutral head, in metres.
        faces: Vertex indices of the triangles.
        displacement: Displacement of the caricature, in metres.
        gamma_f: Level that the caricature stands for.

    Returns:
        The path, with two nodes.
    """
    nodes = np.stack([np.zeros_like(displacement), displacement]).astype(np.float32)
    return GammaPath(np.array([0.0, gamma_f]), nodes, faces, neutral, {"source": "file"})
