"""Adam that can leave rows out, in plain PyTorch: the twin of `training.adam`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int
from torch import Tensor

from carigs.splat.training.adam import BETA_1, BETA_2, EPSILON, Adam, Parameters


class DeviceAdam(Adam):
    """Optimiser state as tensors on the device of the parameters.

    Args:
        parameters: What is optimised.
        state: State to start from; zeros if None.
    """

    def __init__(self, parameters: Parameters, state: Adam | None = None) -> None:
        self.steps = 0
        self.first = {name: torch.zeros_like(value, requires_grad=False) for name, value in parameters.attributes()}
        self.second = {name: torch.zeros_like(value) for name, value in self.first.items()}
        if state is not None:
            self.restore(state.steps, state.as_arrays())

    @torch.no_grad()
    def step(
        self, parameters: Parameters, rates: Mapping[str, float], frozen: Bool[Tensor, " n"] | None = None
    ) -> None:
        """Update every attribute by its `.grad`; frozen rows keep their values and moments, see `Adam.step`.

        Args:
            parameters: What is optimised, changed in place.
            rates: Learning rate of every attribute.
            frozen: Rows that are not touched; none if None.
        """
        self.steps += 1
        correction = 1 / math.sqrt(1 - BETA_2**self.steps)
        for name, value in parameters.attributes():
            if value.grad is None or value.numel() == 0:
                continue
            first, second, g = self.first[name], self.second[name], value.grad
            m, v = BETA_1 * first + (1 - BETA_1) * g, BETA_2 * second + (1 - BETA_2) * g * g
            new = value - rates[name] / (1 - BETA_1**self.steps) * m / (v.sqrt() * correction + EPSILON)
            for old, changed in ((first, m), (second, v), (value, new)):
                old.copy_(changed if frozen is None else torch.where(_rows(frozen, old), old, changed))

    def reorder(self, source: Int[np.ndarray, " m"], is_new: Bool[np.ndarray, " m"]) -> None:
        """Follow a change of the rows.

        Args:
            source: Index of the old row that each row comes from.
            is_new: Rows whose moments start from zero.
        """
        for moments in (self.first, self.second):
            for name, value in moments.items():
                index, new = (torch.from_numpy(np.ascontiguousarray(a)).to(value.device) for a in (source, is_new))
                moved = value[index]
                moments[name] = moved.masked_fill_(_rows(new, moved), 0)

    def as_arrays(self) -> dict[str, Float32[np.ndarray, " n *_"]]:
        """The moments, for a checkpoint.

        Returns:
            Arrays by name, as `Adam.as_arrays`.
        """
        both = {f"first_{k}": v for k, v in self.first.items()} | {f"second_{k}": v for k, v in self.second.items()}
        return {name: value.cpu().numpy() for name, value in both.items()}

    def restore(self, steps: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Set the state.

        Args:
            steps: Number of steps done.
            arrays: Result of `as_arrays`, of this class or of `Adam`.
        """
        self.steps = steps
        for moments, prefix in ((self.first, "first"), (self.second, "second")):
            for name, moment in moments.items():
                moment.copy_(torch.from_numpy(arrays[f"{prefix}_{name}"]))


def _rows(mask: Bool[Tensor, " n"], values: Tensor) -> Tensor:
    """The mask, in a shape that broadcasts along the rows of the values."""
    return mask.reshape(-1, *(1,) * (values.ndim - 1))
