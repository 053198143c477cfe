"""The cubic smoothstep function."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def smoothstep(x: Float[np.ndarray, "*n"], low: float = 0.0, high: float = 1.0) -> Float[np.ndarray, "*n"]:
    """Cubic Hermite step: t^2 (3 - 2 t) with t = (x - low) / (high - low), clamped to [0, 1].

    Args:
        x: Values, in the unit of `low` and `high`.
        low: Where the step begins.
        high: Where the step ends.

    Returns:
        0 up to `low`, 1 from `high` on, with a continuous derivative.
    """
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
