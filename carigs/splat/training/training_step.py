"""What a training step is: its inputs, its result, and what the trainer asks of it on any backend."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.capture import Frame
from carigs.settings import Train
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.initial_surfels.initialization import start_distances
from carigs.splat.training.schedule import Schedule
from carigs.splat.training.subject import TrainingSubject

POSITION_LIMIT, SCALE_LIMIT = 1.0, 0.6
"""Distance from the triangle, and standard deviation, up to which a surfel is not penalised, in units of the triangle
(Qian et al. 2024)."""
POSITION_WEIGHT, SCALE_WEIGHT = 0.01, 1.0
"""Weights in the loss of what is beyond these limits, those of SurFhead."""
SSIM_WEIGHT = 0.2
"""Weight lambda of the photometric loss, that of Gaussian splatting (Kerbl et al. 2023)."""
REGULARIZED_FROM = 0.25
"""Share of the steps before the regularizers of the images: those of SurFhead begin after 30,000 of 120,000 steps."""
PREFETCHED = 4
"""Steps whose images are decoded ahead."""


class StepResult(NamedTuple):
    """What a step leaves for the log.

    Attributes:
        loss: The loss; a tensor where to read it would wait for a device.
        image: The rendered image.
        target: What it was compared with.
        valid: Pixels that supervised; all if None.
    """

    loss: float | Float[Tensor, ""]
    image: Float[Tensor, "h w 3"]
    target: Float[Tensor, "h w 3"]
    valid: Bool[Tensor, "h w"] | None


@dataclass
class StepInputs:
    """Inputs of all steps of a training.

    Attributes:
        settings: Settings of the stage.
        subject: Motion of the head, training frames and targets, hair and mouth.
        schedule: The example of every step.
    """

    settings: Train
    subject: TrainingSubject
    schedule: Schedule

    @cached_property
    def position_limit(self) -> Float[np.ndarray, " f"]:
        """Distance from each triangle up to which positions are not penalised.

        Surfels of hair, mouth and body start away from their triangles.
        """
        hair = self.subject.hair
        points = self.subject.inside if hair is None else [*hair.all_points, *self.subject.inside]
        return POSITION_LIMIT + start_distances(self.subject.sequence.rig, points)

    @cached_property
    def only_targets(self) -> bool:
        """Whether no step takes a real frame."""
        return bool(self.schedule.gtstar.all())

    def scheduled(self, i: int) -> tuple[bool, int]:
        """The example of a step.

        Args:
            i: The step.

        Returns:
            Whether it is a GT* target, and its index.
        """
        return bool(self.schedule.gtstar[i]), int(self.schedule.index[i])

    def refines_tracking(self, i: int) -> bool:
        """Whether a step changes the tracked head parameters of its timestep.

        Args:
            i: The step.

        Returns:
            Whether it does: before `train.refine_tracking.until`, if its example is a real frame.
        """
        early = i < self.settings.refine_tracking.until * self.settings.iterations
        return early and not self.scheduled(i)[0]

    def counts_gradients(self, i: int) -> bool:
        """Whether density control counts the gradients of a step.

        Args:
            i: The step.

        Returns:
            True for real frames, and for targets if there is nothing else.
        """
        return self.settings.density.every > 0 and (self.only_targets or not self.scheduled(i)[0])

    def regularizers(self, i: int) -> tuple[bool, bool]:
        """Which regularizers of the images are in the loss of a step.

        Args:
            i: The step.

        Returns:
            Whether distortion and normal consistency are.
        """
        on = i >= REGULARIZED_FROM * self.settings.iterations
        return on and self.settings.distortion_weight > 0, on and self.settings.normal_weight > 0

    def decode_ahead(self, i: int) -> None:
        """Begin to decode the images of the steps after one.

        Args:
            i: The step.
        """
        for k in range(i + 1, min(i + 1 + PREFETCHED, self.settings.iterations)):
            self.subject.supervision.prefetch(*self.scheduled(k))


class TrainingStep(Protocol):
    """A step of the training on one backend: everything but density control, which the trainer does on the host."""

    def place(self, state: TrainingState) -> None:
        """Bring a state to where the step works on it.

        Args:
            state: The state of the run, on the host; changed in place.
        """

    def start_statistics(self, state: TrainingState) -> None:
        """Go on after density control: forget the gradients before it.

        Args:
            state: The state of the run, with surfels on the host; changed in place.
        """

    def forget_images(self) -> None:
        """Forget images that were read ahead: one of them has been replaced."""

    def update(self, state: TrainingState, i: int, rates: Mapping[str, float]) -> StepResult:
        """Render, compare, update.

        Args:
            state: The state of the run; changed in place.
            i: The step.
            rates: Learning rate of every attribute.

        Returns:
            Loss and images.
        """

    def image(self, surfels: Surfels, frame: Frame) -> Float[np.ndarray, "h w 3"]:
        """Render a frame at level 0.

        Args:
            surfels: The surfels, where the step works on them.
            frame: The view.

        Returns:
            RGB, not clamped, on the host.
        """

    def contribution(self, surfels: Surfels, frame: Frame, level: float) -> Float[np.ndarray, " n"]:
        """Contribution of every surfel to a frame, see `render.contribution`.

        Args:
            surfels: The surfels, where the step works on them.
            frame: The view.
            level: Exaggeration of the mesh.

        Returns:
            Sums in pixels.
        """
