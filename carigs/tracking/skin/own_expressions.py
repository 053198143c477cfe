"""Blendshapes of one person's own: movements of the skin that a head model cannot make, found in the frames.

Landmarks leave the skin between them where the blendshapes of other people take it. On footage of a person it was off
by 0.7 mm in half of the pixels, and by 1.8 mm in a tenth of them, differently in every frame: the colours that a
training finds are then averages over the neighbourhood.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from carigs.head import HeadModel, HeadParameters
from carigs.tracking.own_blendshapes import principal_shapes, with_own_blendshapes
from carigs.tracking.skin.face_chart import FaceChart, UnwrappedFrame
from carigs.tracking.skin.groupwise_flow import flows_to_mean

MODES = 36
"""Most blendshapes. On footage of a person, held-out faces had 30.7, 31.0 and 31.5 dB with 12, 24 and 36 of them."""
TIMESTEPS_PER_MODE = 4
"""Fewest timesteps for each of them."""


def own_expressions(
    model: HeadModel,
    parameters: Sequence[HeadParameters],
    chart: FaceChart,
    skin: Sequence[UnwrappedFrame],
    timesteps: Sequence[int],
) -> tuple[HeadModel, list[HeadParameters]]:
    """Add the person's own blendshapes to a head model, the principal components of what the skin does in the frames.

    Args:
        model: The head model.
        parameters: Those of each timestep.
        chart: The chart of its neutral face.
        skin: The frames in the chart.
        timesteps: That of each frame.

    Returns:
        The model with more expressions, and parameters with their coefficients, whose root mean square is 1. Both
        are as they were if there are too few timesteps.
    """
    count = min(MODES, len(parameters) // TIMESTEPS_PER_MODE)
    if not count:
        return model, list(parameters)
    moved = _displacements(chart, skin, np.asarray(timesteps), len(parameters))
    components, coefficients = principal_shapes(moved, count)
    shapes = np.zeros((*model.v_template.shape, components.shape[2]), np.float32)
    shapes[chart.vertices] = components
    return with_own_blendshapes(model, parameters, shapes, coefficients)


def _displacements(
    chart: FaceChart, skin: Sequence[UnwrappedFrame], timesteps: Int[np.ndarray, " k"], count: int
) -> Float[np.ndarray, "t n 3"]:
    """Displacements of the chart's vertices at each timestep; all cameras of a timestep tell one."""
    flows, moved = flows_to_mean(skin), np.zeros((count, len(chart.vertices), 3))
    for t in np.unique(timesteps):
        views = np.flatnonzero(timesteps == t)
        weight = sum(skin[i].weight for i in views)
        flow = sum(skin[i].weight[..., None] * flows[i] for i in views) / np.maximum(weight, 1e-6)[..., None]
        moved[t] = chart.displacement(flow, np.minimum(weight, 1))
    return moved
