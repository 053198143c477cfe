"""Surfels and the state of a training between the host and a device."""

from __future__ import annotations

from dataclasses import replace

import torch

from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.device.adam import DeviceAdam
from carigs.splat.training.device.statistics import DeviceStatistics


def place_surfels(surfels: Surfels, device: torch.device) -> Surfels:
    """Copy surfels to a device.

    Args:
        surfels: Surfels on any device.
        device: The device.

    Returns:
        Leaf tensors of the same values; the binding stays on the host.
    """
    leaves = {name: value.detach().to(device, copy=True) for name, value in surfels.attributes()}
    return replace(surfels, **{name: leaf.requires_grad_(True) for name, leaf in leaves.items()})


def place_state(state: TrainingState, device: torch.device) -> None:
    """Move surfels, optimiser and statistics of a training to a device, in place.

    Args:
        state: A state on the host.
        device: The device.
    """
    state.surfels = place_surfels(state.surfels, device)
    state.adam = DeviceAdam(state.surfels, state.adam)
    state.statistics = DeviceStatistics(state.statistics, device)
