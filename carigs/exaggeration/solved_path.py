"""How many exact solves a path needs, and the path through them.

The weights |K|^gamma are entire functions of gamma, so the error falls faster than geometrically with the nodes.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Protocol

import numpy as np
from jaxtyping import Float

from carigs.errors import SettingsError
from carigs.exaggeration.gamma_path import GammaPath
from carigs.exaggeration.lobatto_interpolation import barycentric, lagrange_weights, lobatto_levels
from carigs.mesh.triangle_mesh import diagonal

if TYPE_CHECKING:
    from carigs.exaggeration.exaggerator import Exaggerator

MOST_NODES = 12


class Solvable(Protocol):
    """A head, or a region of one: what `solved_path` interpolates."""

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """W per face."""

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
    count, error = settings.path_nodes, None
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
    errors = [np.array(lagrange_weights(formula, middle)) @ nodes - what.weights(middle) for middle in middles]
    worst = max(errors, key=lambda error: areas @ error**2)
    return float(np.linalg.norm(what.response(worst), axis=1).max())
