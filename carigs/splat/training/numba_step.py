"""The training step on the host, with the Numba kernels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float
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
from carigs.splat.training.training_step import SCALE_LIMIT, StepInputs, StepResult


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

    def update(self, state: TrainingState, i: int, rates: Mapping[str, float]) -> StepResult:
        """Do one step: everything but density control.

        Args:
            state: The state of the run, changed in place.
            i: The step.
            rates: Learning rate of every attribute.

        Returns:
            Loss and images.
        """
        inputs, settings = self.inputs, self.inputs.settings
        gtstar, index = inputs.scheduled(i)
        example = inputs.supervision.example(gtstar, index)
        inputs.decode_ahead(i)
        for _, value in state.surfels.attributes():
            value.grad = None
        rendered, loss = self._loss(state, example, i)
        loss.backward()
        screen = rendered.rendering.screen
        value = float(loss.detach()) + add_threshold_loss(
            state.surfels, screen.visible.numpy(), inputs.position_limit[state.surfels.binding],
            settings.position_weight, SCALE_LIMIT, settings.scale_weight,
        )  # fmt: skip
        frozen = None if example.frozen is None else example.frozen[state.surfels.binding]
        if settings.density.every and (not gtstar or inputs.only_targets):
            state.statistics.add(screen, example.camera)
        if inputs.hair is not None:
            inputs.hair.keep_hidden_skin(state.surfels)
        state.adam.step(state.surfels, rates, frozen)
        if inputs.hair is not None:
            inputs.hair.keep_on_covered_skin(state.surfels)
            if i % FADING_STEPS == 0:
                inputs.hair.fade_over_bare_skin(state.surfels, inputs.sequence.rig)
        valid = None if example.valid is None else torch.from_numpy(example.valid)
        return StepResult(value, rendered.image, torch.from_numpy(example.image), valid)

    def _loss(self, state: TrainingState, example: Example, i: int) -> tuple[RenderedFrame, Float[Tensor, ""]]:
        inputs, settings, sequence = self.inputs, self.inputs.settings, self.inputs.sequence
        distortion, normals = inputs.regularizers(i)
        if inputs.refines_tracking(i):
            motion = state.refinement.motion(example.timestep)
        else:
            motion = sequence.motion(example.timestep, example.level)
        rendered = render(
            state.surfels, sequence.rig, motion, example.camera, skinning=settings.rig,
            rotate_harmonics=settings.rotate_harmonics, background=inputs.supervision.capture.background,
            shade=sequence.shade(example.timestep, example.level), backend=settings.backend,
            outputs=("distortion",) * distortion + ("alpha", "depth", "normal") * normals,
        )  # fmt: skip
        valid = None if example.valid is None else torch.from_numpy(example.valid)
        loss = photometric_loss(rendered.image, torch.from_numpy(example.image), settings.ssim_weight, valid)
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
        settings, sequence = self.inputs.settings, self.inputs.sequence
        with torch.no_grad():
            return render(
                surfels, sequence.rig, sequence.motion(frame.timestep, 0.0),
                self.inputs.supervision.capture.camera(frame), skinning=settings.rig,
                rotate_harmonics=settings.rotate_harmonics, background=self.inputs.supervision.capture.background,
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
        settings, sequence = self.inputs.settings, self.inputs.sequence
        camera, motion = self.inputs.supervision.capture.camera(frame), sequence.motion(frame.timestep, level)
        return contribution(surfels, sequence.rig, motion, camera, skinning=settings.rig, backend=settings.backend)
