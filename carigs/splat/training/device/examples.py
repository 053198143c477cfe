"""Training examples on a device: images, masks and motions, copied from pinned memory ahead of their use."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.capture import Camera
from carigs.splat.training.training_step import StepInputs


class DeviceExample(NamedTuple):
    """An `Example` with its motion and light, on the device.

    Attributes:
        timestep: As in `Example`.
        camera: As in `Example`.
        level: As in `Example`.
        image: As in `Example`.
        valid: As in `Example`.
        frozen: As in `Example`.
        weight: As in `Example`.
        emphasis: As in `Example`.
        records: `FaceMotion.records` of the mesh; None if the tracking is refined, which changes it from step to step.
        shade: Factor of the light on every triangle; None for 1.
    """

    timestep: int
    camera: Camera
    level: float
    image: Float[Tensor, "h w 3"]
    valid: Bool[Tensor, "h w"] | None
    frozen: Bool[Tensor, " f"] | None
    weight: float
    emphasis: Float[Tensor, "h w"] | None
    records: Float[Tensor, "f 32"] | None
    shade: Float[Tensor, "f 3"] | None


class DeviceExamples:
    """The examples of a schedule.

    Images travel as bytes, and become numbers on the device.

    Args:
        inputs: What is trained.
        device: The device.
        refined: Whether the tracking is refined.
    """

    def __init__(self, inputs: StepInputs, device: torch.device, refined: bool) -> None:
        self._inputs, self._device, self._refined = inputs, device, refined
        self._ahead: dict[int, DeviceExample] = {}
        self._frozen: dict[int, Tensor] = {}

    def prefetch(self, i: int) -> None:
        """Begin to copy the example of a step to the device.

        Args:
            i: The step.
        """
        if i not in self._ahead and i < len(self._inputs.schedule.index):
            self._ahead[i] = self._read(i)

    def forget(self) -> None:
        """Forget the examples that were copied ahead."""
        self._ahead = {}

    def take(self, i: int) -> DeviceExample:
        """The example of a step; those of earlier steps are given up.

        Args:
            i: The step.

        Returns:
            The example; its image in [0, 1].
        """
        self.prefetch(i)
        example = self._ahead[i]
        self._ahead = {k: value for k, value in self._ahead.items() if k > i}
        return example._replace(image=example.image.float() / 255)

    def _read(self, i: int) -> DeviceExample:
        stored = self._inputs.subject.supervision.stored_example(*self._inputs.scheduled(i))
        sequence, frozen = self._inputs.subject.sequence, None
        if stored.frozen is not None:
            key = id(stored.frozen)  # the supervision holds the arrays, of which each level has one
            if key not in self._frozen:
                self._frozen[key] = self.copied(stored.frozen)
            frozen = self._frozen[key]
        motion = None if self._refined else sequence.motion(stored.timestep, stored.level).records
        # As planes: so they lie in memory.
        image = self.copied(stored.image.transpose(2, 0, 1)).permute(1, 2, 0)
        shade = sequence.shade(stored.timestep, stored.level)
        valid, emphasis, records, shade = map(self.copied, (stored.valid, stored.emphasis, motion, shade))
        return DeviceExample(
            stored.timestep, stored.camera, stored.level, image, valid, frozen, stored.weight, emphasis, records, shade
        )

    def copied(self, array: np.ndarray | None) -> Tensor | None:
        """Copy an array to the device; to a CUDA device through pinned memory, without waiting.

        Args:
            array: Any array, or None.

        Returns:
            A tensor, or None.
        """
        if array is None:
            return None
        tensor = torch.from_numpy(np.ascontiguousarray(array))
        if self._device.type == "cuda":
            return tensor.pin_memory().to(self._device, non_blocking=True)
        return tensor.to(self._device)
