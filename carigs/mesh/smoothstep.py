"""The cubic smoothstep function, for NumPy and for kernels."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba.extending import register_jitable


@register_jitable
def smoothstep(
    x: float | Float[np.ndarray, "*n"], low: float = 0.0, high: float = 1.0
) -> float | Float[np.ndarray, "*n"]:
    """Cubic Hermite step: t^2 (3 - 2 t) with t = (x - low) / (high - low), clamped to [0, 1].

    Args:
        x: A value or values, in the unit of `low` and `high`.
        low: Where the step begins.
        high: Where the step ends.

    Returns:
        0 up to `low`, 1 from `high` on, with a continuous derivative.
    """
    t = np.minimum(np.maximum((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)
