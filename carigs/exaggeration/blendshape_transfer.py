"""Expressions on a caricature: what moves the head, moved as the exaggeration moves the head itself.

The map T = 1 + A^+ W_(w-1) of a level, with A and w of the neutral, is linear in the vertices and takes S to S_level.
(For A = W it is W^+ W_w.)  Applied to S + d it gives S_level + T d: T d is the motion d as the caricature makes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from carigs.exaggeration.gamma_path import GammaPath
from carigs.exaggeration.rigid_components import similarity

if TYPE_CHECKING:
    from carigs.exaggeration.exaggerator import Exaggerator

SHARES = {"offset": 0.0, "mixed": 0.5, "linear": 1.0}
"""How much of T d - d a motion gets.  Lids of an exaggerated head need more than `offset` to close and less than T."""


def transferred(
    solver: Exaggerator, motion: Float[np.ndarray, "v 3"], weights: Float[np.ndarray, " f"]
) -> Float[np.ndarray, "v 3"]:
    """T d of a motion d, for the weights w of a level; each component keeps its mean motion."""
    return motion + solver.response(weights - 1, motion)


def with_blendshapes(
    path: GammaPath,
    solver: Exaggerator,
    motions: Float[np.ndarray, "b v 3"],
    columns: Int[np.ndarray, " b"],
    levels: Mapping[str, float] | None = None,
) -> GammaPath:
    """The path with what its levels change in the `motions`, which belong to these columns of the codes.

    How much is the solver's setting `expressions`; `levels` are those of regions that the path was made with.
    Components that follow by a similarity turn and scale their motions by it.
    """
    share = SHARES[solver.settings.blendshape_transfer]
    if share == 0 or len(motions) == 0:
        return path
    changes = np.zeros((len(path.levels) - 1, *motions.shape), np.float32)
    weights_at = solver.whole(path.gamma_f, levels).weights
    for at_level, level, displacement in zip(changes, path.levels[1:], path.displacements[1:], strict=True):
        weights, linear = weights_at(float(level)), _followed(solver, displacement)
        for change, motion in zip(at_level, motions, strict=True):
            moved = transferred(solver, motion, weights)
            for inside, scaled_rotation in linear:
                moved[inside] = motion[inside] @ scaled_rotation.T
            change[:] = share * (moved - motion)
    return replace(path, columns=columns, changes=changes)


def _followed(
    solver: Exaggerator, displacement: Float[np.ndarray, "v 3"]
) -> list[tuple[Int[np.ndarray, " _"], Float[np.ndarray, "3 3"]]]:
    """Vertices of each component that follows, and the linear part of its similarity."""
    if not solver.settings.rigid_components:
        return []
    parts = [np.flatnonzero(solver.component == c) for c in range(solver.component.max() + 1) if c != solver.main]
    moved = solver.vertices + displacement
    fits = [similarity(solver.vertices[part], moved[part]) for part in parts]
    return [(part, scale * rotation) for part, (scale, rotation, _) in zip(parts, fits, strict=True)]
