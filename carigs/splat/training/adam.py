"""Adam (Kingma and Ba 2015) that can leave rows out.

A surfel that is frozen in a step keeps its values and its moments: with zero gradients alone, momentum would move it.
One kernel over rows gives the same bytes with any number of threads, which PyTorch's Adam does not promise. It takes
sixteen numbers at a time from the rows between two frozen ones, and the last few of them through a copy, so that
no number is rounded otherwise because of its place.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float32, Int
from torch import Tensor

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, load, store
from carigs.simd.vector_math import sqrt
from carigs.simd.vectors import WIDTH, simd_inline, simd_inline_alloc

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-15
PART = 1024  # rows of one task
B1, B2, EPS = np.float32(BETA_1), np.float32(BETA_2), np.float32(EPSILON)
C1, C2 = np.float32(1 - BETA_1), np.float32(1 - BETA_2)  # rounded once: 1 - float32(0.999) has an error of 5e-5


class Parameters(Protocol):
    """Rows with named float32 attributes, such as `Surfels`."""

    def __len__(self) -> int: ...

    def attributes(self) -> Iterable[tuple[str, Tensor]]:
        """Name and tensor of every attribute.

        Returns:
            Pairs; the first axis of each tensor are the rows.
        """


class Adam:
    """Optimiser state: the first and second moments of every attribute, in the order of the rows.

    Args:
        parameters: What is optimised.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.steps = 0
        self.first = {name: np.zeros(value.shape, np.float32) for name, value in parameters.attributes()}
        self.second = {name: np.zeros_like(value) for name, value in self.first.items()}

    def step(
        self, parameters: Parameters, rates: Mapping[str, float], frozen: Bool[np.ndarray, " n"] | None = None
    ) -> None:
        """Update every attribute by its `.grad`; frozen rows keep their values and moments (freezing).

        With gradient g: m = b1 m + (1 - b1) g, v = b2 v + (1 - b2) g^2, and the update -rate m' / (sqrt(v') + eps) with
        m' = m / (1 - b1^t), v' = v / (1 - b2^t).

        Args:
            parameters: What is optimised, changed in place.
            rates: Learning rate of every attribute.
            frozen: Rows that are not touched; none if None.
        """
        self.steps += 1
        n = len(parameters)
        frozen = np.zeros(n, np.bool_) if frozen is None else frozen
        for name, value in parameters.attributes():
            if value.grad is None or value.numel() == 0:
                continue
            step_size = rates[name] / (1 - BETA_1**self.steps)
            correction = 1 / math.sqrt(1 - BETA_2**self.steps)
            arrays = (value.detach().numpy(), value.grad.numpy(), self.first[name], self.second[name])
            _update(frozen, *(a.reshape(-1) for a in arrays), np.float32(step_size), np.float32(correction))

    def reorder(self, source: Int[np.ndarray, " m"], is_new: Bool[np.ndarray, " m"]) -> None:
        """Follow a change of the rows.

        Args:
            source: Index of the old row that each row comes from.
            is_new: Rows whose moments start from zero.
        """
        for moments in (self.first, self.second):
            for name, value in moments.items():
                moments[name] = value[source]
                moments[name][is_new] = 0

    def as_arrays(self) -> dict[str, Float32[np.ndarray, " n *_"]]:
        """The moments, for a checkpoint.

        Returns:
            Arrays by name.
        """
        return {f"first_{k}": v for k, v in self.first.items()} | {f"second_{k}": v for k, v in self.second.items()}

    def restore(self, steps: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Set the state.

        Args:
            steps: Number of steps done.
            arrays: Result of `as_arrays`.

        Raises:
            ValueError: If an array has another shape or type.
        """
        self.steps = steps
        for moments, prefix in ((self.first, "first"), (self.second, "second")):
            for name, moment in moments.items():
                found = arrays[f"{prefix}_{name}"]
                if found.shape != moment.shape or found.dtype != moment.dtype:
                    raise ValueError(f"{prefix}_{name}: {found.dtype} {found.shape}")
                moments[name] = found.copy()


@simd_inline
def _update_vector(at, value, gradient, first, second, step_size, correction):
    """Update the numbers `at` to `at + 15`."""
    g = load(gradient, at)
    m = B1 * load(first, at) + C1 * g
    v = B2 * load(second, at) + C2 * g * g
    store(first, at, m)
    store(second, at, v)
    store(value, at, load(value, at) - step_size * m / (sqrt(v) * correction + EPS))


@simd_inline
def _update_range(begin, stop, value, gradient, first, second, step_size, correction, scratch):
    whole = begin + (stop - begin) // WIDTH * WIDTH
    for at in range(begin, whole, WIDTH):
        _update_vector(at, value, gradient, first, second, step_size, correction)
    if whole < stop:
        for k in range(stop - whole):
            scratch[0][k], scratch[1][k] = value[whole + k], gradient[whole + k]
            scratch[2][k], scratch[3][k] = first[whole + k], second[whole + k]
        _update_vector(0, scratch[0], scratch[1], scratch[2], scratch[3], step_size, correction)
        for k in range(stop - whole):
            value[whole + k], first[whole + k], second[whole + k] = scratch[0][k], scratch[2][k], scratch[3][k]


@simd_inline_alloc
def _update_part(part, frozen, value, gradient, first, second, step_size, correction):
    align_stack()
    columns, stop = value.size // frozen.size, min((part + 1) * PART, frozen.size)
    scratch = (np.zeros(WIDTH, np.float32), np.zeros(WIDTH, np.float32),
               np.zeros(WIDTH, np.float32), np.zeros(WIDTH, np.float32))  # fmt: skip
    i = part * PART
    while i < stop:
        begin = i
        while i < stop and not frozen[i]:
            i += 1
        _update_range(begin * columns, i * columns, value, gradient, first, second, step_size, correction, scratch)
        while i < stop and frozen[i]:
            i += 1


@kernel
def _update(frozen, *arguments):
    parallel_for(_update_part, (len(frozen) + PART - 1) // PART, (frozen, *arguments))
