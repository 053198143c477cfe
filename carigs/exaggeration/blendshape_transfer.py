"""Transfer of blendshapes to the caricature, by the linear map that the exaggeration applies to the head itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from carigs.exaggeration.exaggerator import Exaggerator
from carigs.exaggeration.gamma_path import GammaPath
from carigs.exaggeration.rigid_components import umeyama

TRANSFER_FACTORS = {"offset": 0.0, "mixed": 0.5, "linear": 1.0}
"""Factor c in d + c (T d - d), by `exaggerate.blendshape_transfer`.

The lids of a caricature do not close with 0, and close too far with 1.
"""


def linear_transfer(
    exaggerator: Exaggerator, blendshape: Float[np.ndarray, "v 3"], weights: Float[np.ndarray, " f"]
) -> Float[np.ndarray, "v 3"]:
    """Apply the linear map T of the exaggeration to a blendshape d: T d = d + W^+ W_(w - 1) d.

    For fixed weights w the solution of the weighted Poisson equation (paper, equation 2) is linear in the vertices of
    S: S_gamma = T S. Hence T (S + d) = S_gamma + T d. In the preset `robust`, `WeightedPoisson.system` replaces W.

    Args:
        exaggerator: The solver of the neutral head.
        blendshape: Displacement d of each vertex.
        weights: Weights w of the faces at a level.

    Returns:
        T d, in the unit of d; the mean of each component does not change.
    """
    return blendshape + exaggerator.response(weights - 1, blendshape)


def transfer_blendshapes(
    path: GammaPath,
    exaggerator: Exaggerator,
    blendshapes: Float[np.ndarray, "b v 3"],
    columns: Int[np.ndarray, " b"],
    levels: Mapping[str, float] | None = None,
) -> GammaPath:
    """Add to a path the change of blendshapes at its nodes: c (T d - d), with `TRANSFER_FACTORS` c.

    The blendshapes of a rigid component are rotated and scaled by its similarity transform.

    Args:
        path: Path of the neutral head.
        exaggerator: The solver that made the path; its setting `blendshape_transfer` selects the factor.
        blendshapes: Expressions and pose correctives d, in the unit of the head.
        columns: Index of each blendshape, as in `Caricature.columns`.
        levels: Levels of regions that the path was made with.

    Returns:
        The path with the changes; the same path if the factor is 0 or there is no blendshape.
    """
    factor = TRANSFER_FACTORS[exaggerator.settings.blendshape_transfer]
    if factor == 0 or len(blendshapes) == 0:
        return path
    changes = np.zeros((len(path.levels) - 1, *blendshapes.shape), np.float32)
    rates = exaggerator.level_rates(path.gamma_f, levels)
    for node_changes, level, displacement in zip(changes, path.levels[1:], path.displacements[1:], strict=True):
        weights = exaggerator.weights(float(level), rates)
        transforms = _rigid_transforms(exaggerator, displacement)
        for change, blendshape in zip(node_changes, blendshapes, strict=True):
            transferred = linear_transfer(exaggerator, blendshape, weights)
            for members, scaled_rotation in transforms:
                transferred[members] = blendshape[members] @ scaled_rotation.T
            change[:] = factor * (transferred - blendshape)
    return replace(path, columns=columns, changes=changes)


def _rigid_transforms(
    exaggerator: Exaggerator, displacement: Float[np.ndarray, "v 3"]
) -> list[tuple[Int[np.ndarray, " _"], Float[np.ndarray, "3 3"]]]:
    """Vertices of each small component, and scale times rotation of its similarity transform."""
    if not exaggerator.settings.rigid_components:
        return []
    labels, moved, transforms = exaggerator.component_labels, exaggerator.vertices + displacement, []
    for c in np.setdiff1d(labels, [exaggerator.main_component]):
        members = np.flatnonzero(labels == c)
        scale, rotation, _ = umeyama(exaggerator.vertices[members], moved[members])
        transforms.append((members, scale * rotation))
    return transforms
