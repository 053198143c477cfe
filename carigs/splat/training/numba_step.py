"""The training step on the host, with the Numba kernels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.capture import Frame
from carigs.splat.render import RenderedFrame, contribution, render
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.density import GradientStatistics
from carigs.splat.training.initial_surfels.hair_surfels import FADING_STEPS
from carigs.splat.training.photometric_loss import photometric_loss
from carigs.splat.training.regularizers import add_threshold_loss, normal_consistency_loss
from carigs.splat.training.supervision import Example
from carigs.splat.training.training_step import (
    POSITION_WEIGHT,
    SCALE_LIMIT,
    SCALE_WEIGHT,
    SSIM_WEIGHT,
    StepInputs,
    StepResult,
)


class NumbaStep:
    """Render, compare, update: on the host.

    Args:
        inputs: What is trained.
    """

    def __init__(self, inputs: StepInputs) -> None:
        self.inputs = inputs

    def place(self, state: TrainingState) -> None:
        """Bring a state to where the step works on it: it is there.

        Args:
            state: The state of the run.
        """

    def start_statistics(self, state: TrainingState) -> None:
        """Forget the gradients since the last density control.

        Args:
            state: The state of the run, after it.
        """
        state.statistics = GradientStatistics(len(state.surfels))

    def forget_images(self) -> None:
        """Forget images that were read ahead: files alone are, and edited frames are no files."""

    def update(self, state: TrainingState, i: int, rates: Mapping[str, float]) -> StepResult:
        """Do one step: everything but density control.

        Args:
            state: The state of the run, changed in place.
            i: The step.
            rates: Learning rate of every attribute.

        Returns:
            Loss and images.
        """
        inputs, surfels, hair = self.inputs, state.surfels, self.inputs.subject.hair
        example = self._example(i)
        inputs.decode_ahead(i)
        for _, value in surfels.attributes():
            value.grad = None
        rendered, loss = self._loss(state, example, i)
        screen = rendered.rendering.screen
        loss.backward()
        # After the backward pass: it adds its own gradients, at the visible surfels alone.
        total = float(loss.detach()) + self._add_threshold_loss(surfels, screen.visible.numpy())
        if inputs.counts_gradients(i):
            state.statistics.add(screen, example.camera)
        if hair is not None:
            hair.keep_hidden_skin(surfels)
        if inputs.subject.same_from_all_sides is not None and surfels.harmonics.grad is not None:
            surfels.harmonics.grad.numpy()[inputs.subject.same_from_all_sides[surfels.binding]] = 0
        state.adam.step(surfels, rates, None if example.frozen is None else example.frozen[surfels.binding])
        if hair is not None:
            hair.keep_on_covered_skin(surfels)
            if i % FADING_STEPS == 0:
                hair.fade_over_bare_skin(surfels, inputs.subject.sequence.rig)
        valid = None if example.valid is None else torch.from_numpy(example.valid)
        return StepResult(total, rendered.image, torch.from_numpy(example.image), valid)

    def _example(self, i: int) -> Example:
        return self.inputs.subject.supervision.example(*self.inputs.scheduled(i))

    def _add_threshold_loss(self, surfels: Surfels, visible: Bool[np.ndarray, " n"]) -> float:
        limit = self.inputs.position_limit[surfels.binding]
        return add_threshold_loss(surfels, visible, limit, POSITION_WEIGHT, SCALE_LIMIT, SCALE_WEIGHT)

    def _loss(self, state: TrainingState, example: Example, i: int) -> tuple[RenderedFrame, Float[Tensor, ""]]:
        inputs, settings, sequence = self.inputs, self.inputs.settings, self.inputs.subject.sequence
        distortion, normals = inputs.regularizers(i)
        if inputs.refines_tracking(i):
            motion = state.refinement.motion(example.timestep)
        else:
            motion = sequence.motion(example.timestep, example.level)
        rendered = render(
            state.surfels, sequence.rig, motion, example.camera, skinning=settings.rig,
            rotate_harmonics=settings.rotate_harmonics, background=inputs.subject.supervision.capture.background,
            shade=sequence.shade(example.timestep, example.level), backend=settings.backend,
            outputs=("distortion",) * distortion + ("alpha", "depth", "normal") * normals,
        )  # fmt: skip
        valid = None if example.valid is None else torch.from_numpy(example.valid)
        loss = photometric_loss(
            rendered.image, torch.from_numpy(example.image), SSIM_WEIGHT, valid,
            None if example.emphasis is None else torch.from_numpy(example.emphasis),
        )  # fmt: skip
        rendering = rendered.rendering
        if distortion:
            loss = loss + settings.distortion_weight * rendering.distortion.mean()
        if normals:
            consistency = normal_consistency_loss(rendering.normal, rendering.depth, rendering.alpha, example.camera)
            loss = loss + settings.normal_weight * consistency
        return rendered, example.weight * loss

    def image(self, surfels: Surfels, frame: Frame) -> Float[np.ndarray, "h w 3"]:
        """Render a frame at level 0.

        Args:
            surfels: The surfels.
            frame: The view.

        Returns:
            RGB, not clamped.
        """
        settings, sequence = self.inputs.settings, self.inputs.subject.sequence
        capture = self.inputs.subject.supervision.capture
        with torch.no_grad():
            return render(
                surfels, sequence.rig, sequence.motion(frame.timestep, 0.0),
                capture.camera(frame), skinning=settings.rig, rotate_harmonics=settings.rotate_harmonics,
                background=capture.background,
                shade=sequence.shade(frame.timestep, 0.0), backend=settings.backend,
            ).image.numpy()  # fmt: skip

    def contribution(self, surfels: Surfels, frame: Frame, level: float) -> Float[np.ndarray, " n"]:
        """Contribution of every surfel to a frame, see `render.contribution`.

        Args:
            surfels: The surfels.
            frame: The view.
            level: Exaggeration of the mesh.

        Returns:
            Sums in pixels.
        """
        settings, sequence = self.inputs.settings, self.inputs.subject.sequence
        camera, motion = self.inputs.subject.supervision.capture.camera(frame), sequence.motion(frame.timestep, level)
        return contribution(surfels, sequence.rig, motion, camera, skinning=settings.rig, backend=settings.backend)
