"""How the light on the triangles changes over the clip and with the caricature, for the page.

Shadows have no closed form in the level, and to compute them takes a good part of a second. The page has the factors on
the colours of every timestep at level 0 and at the highest, and interpolates linearly between. What the interpolation
lacks at the levels between, and what each region changes, is computed at the first timestep alone and added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.exaggeration import Caricature, GammaPath
from carigs.head import HeadParameters, pose
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.viewer.html.low_rank import low_rank
from carigs.viewer.html.packed_arrays import PackedArray, pack_exact, pack_integers, pack_steps

LEVELS = 5
"""Number of levels at which the light is computed at the first timestep, from 0 to the highest."""
TOLERANCE = 0.006
"""Root mean square error of the factors."""
STEP = 0.004


class Light(NamedTuple):
    """Factors on the colours in the clip of the capture, in which those of other frames are expressed."""

    mean: Float[np.ndarray, " m"]
    basis: Float[np.ndarray, "r m"]
    ends: tuple[Caricature | None, Caricature]
    """The natural head, and that of the highest level."""


def light_arrays(
    sequence: HeadSequence, timesteps: Sequence[int], regions: Mapping[str, GammaPath]
) -> tuple[dict[str, Any], list[PackedArray], Light | None]:
    """Pack the factors on the colours of the triangles.

    Args:
        sequence: Head model, parameters over time, gamma path and shading.
        timesteps: The clip.
        regions: Path of each region that has a slider.

    Returns:
        Numbers for the header of the page, the arrays, and what other frames need; none of it if colours do not follow
        the light.
    """
    if sequence.shading is None:
        return {"lightLevels": []}, [], None
    levels = np.linspace(0, sequence.path.gamma_f, LEVELS)
    highest = sequence.path.at(sequence.path.gamma_f)
    ends = np.array([[_factors(sequence, t, caricature) for t in timesteps] for caricature in (None, highest)])
    mean = ends.mean(axis=(0, 1))
    lacking = [
        _factors(sequence, timesteps[0], sequence.path.at(levels[k])) - (ends[0, 0] + share * (ends[1, 0] - ends[0, 0]))
        for k, share in enumerate(np.linspace(0, 1, LEVELS).tolist())
        if 0 < k < LEVELS - 1
    ]
    found = low_rank(np.concatenate([*(ends - mean), lacking]), TOLERANCE, STEP)
    arrays = [
        pack_steps("light_mean", mean, STEP / 4),
        pack_exact("light_coefficients", found.coefficients),
        pack_integers("light_basis", found.basis.T),
    ]
    for i, region in enumerate(regions.values()):
        caricature = Caricature(region.displacements[-1].astype(np.float64))
        change = _factors(sequence, timesteps[0], caricature) - ends[0, 0]
        arrays.append(pack_steps(f"light_region{i}", change, STEP))
    light = Light(mean, found.basis.astype(np.float64), (None, highest))
    return {"lightLevels": levels.tolist()}, arrays, light


def _factors(sequence: HeadSequence, timestep: int, caricature: Caricature | None) -> np.ndarray:
    return light_factors(sequence, sequence.parameters[timestep], caricature)


def light_factors(
    sequence: HeadSequence, parameters: HeadParameters, caricature: Caricature | None
) -> Float[np.ndarray, " m"]:
    """Factors on the colours of every triangle.

    Args:
        sequence: Head model and shading.
        parameters: Head parameters.
        caricature: Change of the head at a level; None for the natural one.

    Returns:
        Three factors for each triangle, one after the other.
    """
    posed = pose(sequence.head, parameters, caricature)
    return sequence.shade_of(posed).reshape(-1).astype(np.float64)
