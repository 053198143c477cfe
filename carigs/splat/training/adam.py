"""Adam (Kingma and Ba 2015) on the surfels' attributes, which can leave rows out.

A surfel that is frozen in a step keeps its values *and* its moments: zero gradients alone would let momentum move it.
One kernel for all rows rounds the same with any number of threads, which torch's own does not promise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.surfels.surfels import Surfels

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-15
PART = 1024  # rows of one task


class Adam:
    """Moments of every attribute, in the order of the surfels."""

    def __init__(self, surfels: Surfels) -> None:
        self.steps = 0
        self.first = {name: np.zeros(value.shape, np.float32) for name, value in surfels.attributes()}
        self.second = {name: np.zeros(value.shape, np.float32) for name, value in surfels.attributes()}

    def step(self, surfels: Surfels, rates: Mapping[str, float], frozen: Bool[np.ndarray, "n"] | None = None) -> None:
        """Move every attribute down its `.grad` at its rate; rows in `frozen` are not touched at all."""
        self.steps += 1
        keep = np.zeros(len(surfels), np.bool_) if frozen is None else frozen
        for name, value in surfels.attributes():
            if value.grad is None or value.numel() == 0:
                continue
            step_size = rates[name] / (1 - BETA_1**self.steps)
            correction = 1 / math.sqrt(1 - BETA_2**self.steps)
            rows = (len(surfels), -1)
            _update(
                value.detach().numpy().reshape(rows),
                value.grad.numpy().reshape(rows),
                self.first[name].reshape(rows),
                self.second[name].reshape(rows),
                keep,
                np.float32(step_size),
                np.float32(correction),
            )

    def take(self, kept: np.ndarray, fresh: Bool[np.ndarray, "m"]) -> None:
        """Follow a change of the surfels: row i comes from row `kept[i]`, with zero moments where `fresh[i]`."""
        for moments in (self.first, self.second):
            for name, value in moments.items():
                moments[name] = value[kept]
                moments[name][fresh] = 0


def as_arrays(adam: Adam) -> dict[str, Float32[np.ndarray, "n *_"]]:
    """The moments by name."""
    return {f"first_{k}": v for k, v in adam.first.items()} | {f"second_{k}": v for k, v in adam.second.items()}


def restore(adam: Adam, steps: int, arrays: Mapping[str, np.ndarray]) -> None:
    """Set the state to what `as_arrays` gave."""
    adam.steps = steps
    for name in adam.first:
        adam.first[name], adam.second[name] = arrays[f"first_{name}"].copy(), arrays[f"second_{name}"].copy()


@scalar_or_simd
def _update_part(part, value, gradient, first, second, keep, step_size, correction):
    b1, b2, eps = np.float32(BETA_1), np.float32(BETA_2), np.float32(EPSILON)
    c1, c2 = np.float32(1 - BETA_1), np.float32(1 - BETA_2)  # rounded once: 1 - float32(0.999) is off by 5e-5
    for i in range(part * PART, min((part + 1) * PART, len(value))):
        if keep[i]:
            continue
        for c in range(value.shape[1]):
            g = gradient[i, c]
            m = b1 * first[i, c] + c1 * g
            v = b2 * second[i, c] + c2 * g * g
            first[i, c], second[i, c] = m, v
            value[i, c] -= step_size * m / (np.sqrt(v) * correction + eps)


@kernel
def _update(value, *arguments):
    parallel_for(_update_part, (len(value) + PART - 1) // PART, (value, *arguments))
