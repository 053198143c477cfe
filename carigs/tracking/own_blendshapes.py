"""A head model with blendshapes of one person's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from carigs.head import HeadModel, HeadParameters


def with_own_blendshapes(
    model: HeadModel,
    parameters: Sequence[HeadParameters],
    shapes: Float[np.ndarray, "v 3 k"],
    coefficients: Float[np.ndarray, "t k"],
) -> tuple[HeadModel, list[HeadParameters]]:
    """Add expressions to a head model.

    Args:
        model: The head model, which may have own expressions already.
        parameters: Those of each timestep.
        shapes: The blendshapes in metres.
        coefficients: Of each timestep.

    Returns:
        The model with more expressions, which lie behind those with names and before others, so that names still say
        which coefficient is whose; and parameters with their coefficients.
    """
    named, count = model.expression_names, shapes.shape[2]
    place = len(named) or model.num_expressions
    names = (*named, *(f"own_{number}" for number in range(place, place + count))) if named else ()
    before, after = np.split(model.shapedirs, [model.num_identity + place], axis=2)
    basis = np.concatenate([before, shapes.astype(model.shapedirs.dtype), after], axis=2)
    larger = replace(model, shapedirs=basis, expression_names=names)
    return larger, [
        replace(frame, expression=np.concatenate([frame.expression[:place], own, frame.expression[place:]]))
        for frame, own in zip(parameters, coefficients, strict=True)
    ]
