"""The training step in plain PyTorch on a device, with a rasterizer for it.

Between two rows of the log the host gives orders and reads nothing back, except where density control or a checkpoint
needs the state, and where tracking refinement updates the mesh.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from carigs.capture import Camera, Frame
from carigs.splat.rasterizer.interface import Rendering, WorldSurfels
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.density import GradientStatistics
from carigs.splat.training.device.colour import seen_colour
from carigs.splat.training.device.device import open_device
from carigs.splat.training.device.examples import DeviceExample, DeviceExamples
from carigs.splat.training.device.hair_rules import HairRules
from carigs.splat.training.device.mesh import device_mesh
from carigs.splat.training.device.photometric_loss import photometric_loss
from carigs.splat.training.device.placement import place_state, place_surfels
from carigs.splat.training.device.skinning import skin
from carigs.splat.training.device.statistics import DeviceStatistics
from carigs.splat.training.device.threshold_loss import threshold_loss
from carigs.splat.training.initial_surfels.hair_surfels import FADING_STEPS
from carigs.splat.training.regularizers import normal_consistency_loss
from carigs.splat.training.training_step import (
    POSITION_WEIGHT,
    SCALE_LIMIT,
    SCALE_WEIGHT,
    SSIM_WEIGHT,
    StepInputs,
    StepResult,
)


class DeviceStep:
    """Render, compare, update: on a device.

    Args:
        inputs: What is trained.

    Raises:
        SettingsError: If the device of the settings is not available.
    """

    def __init__(self, inputs: StepInputs) -> None:
        self.inputs = inputs
        self.device, self._rasterize = open_device(inputs.settings)
        self._mesh = device_mesh(inputs.subject.sequence.rig, self.device)
        self._limit = torch.from_numpy(inputs.position_limit).float().to(self.device)
        self._hair = None if inputs.subject.hair is None else HairRules(inputs.subject.hair, self._mesh, self.device)
        same = inputs.subject.same_from_all_sides
        self._same = None if same is None else torch.from_numpy(same).to(self.device)
        self._examples: DeviceExamples | None = None
        self._bound: tuple[np.ndarray | None, Tensor | None] = (None, None)

    def place(self, state: TrainingState) -> None:
        """Move a state to the device.

        Args:
            state: The state of the run, on the host; changed in place.
        """
        place_state(state, self.device)
        self._examples = DeviceExamples(self.inputs, self.device, state.refinement is not None)

    def start_statistics(self, state: TrainingState) -> None:
        """Forget the gradients since the last density control, whose surfels are on the host.

        Args:
            state: The state of the run, after it.
        """
        state.surfels = place_surfels(state.surfels, self.device)
        state.statistics = DeviceStatistics(GradientStatistics(len(state.surfels)), self.device)

    def forget_images(self) -> None:
        """Forget images that were copied to the device ahead."""
        self._examples.forget()

    def update(self, state: TrainingState, i: int, rates: Mapping[str, float]) -> StepResult:
        """Do one step: everything but density control.

        Args:
            state: The state of the run, changed in place.
            i: The step.
            rates: Learning rate of every attribute.

        Returns:
            Loss and images, on the device.
        """
        inputs, surfels, hair = self.inputs, state.surfels, self._hair
        example = self._examples.take(i)
        inputs.decode_ahead(i)
        for _, value in surfels.attributes():
            value.grad = None
        rendering, loss = self._loss(state, example, i)
        screen, binding = rendering.screen, self._binding(surfels)
        total = loss + self._threshold_loss(surfels, screen.visible)
        self._examples.prefetch(i + 1)  # while the device renders
        total.backward()
        _clear_hidden_gradients(surfels, screen.visible)
        if inputs.counts_gradients(i):
            state.statistics.add(screen, example.camera)
        if hair is not None:
            hair.keep_hidden_skin(surfels, binding)
        if self._same is not None and surfels.harmonics.grad is not None:
            surfels.harmonics.grad[self._same[binding]] = 0
        state.adam.step(surfels, rates, None if example.frozen is None else example.frozen[binding])
        if hair is not None:
            hair.keep_on_covered_skin(surfels, binding)
            if i % FADING_STEPS == 0:
                hair.fade_over_bare_skin(surfels, binding)
        return StepResult(total.detach(), rendering.colour.detach(), example.image, example.valid)

    def _threshold_loss(self, surfels: Surfels, visible: Bool[Tensor, " n"]) -> Float[Tensor, ""]:
        limit = self._limit[self._binding(surfels)]
        return threshold_loss(surfels, visible, limit, POSITION_WEIGHT, SCALE_LIMIT, SCALE_WEIGHT)

    def _loss(self, state: TrainingState, example: DeviceExample, i: int) -> tuple[Rendering, Float[Tensor, ""]]:
        settings, records = self.inputs.settings, example.records
        distortion, normals = self.inputs.regularizers(i)
        if records is None:
            records = self._current_motion(state, example, i)
        names = ("colour", *("distortion",) * distortion, *("alpha", "depth", "normal") * normals)
        rendering = self._render(state.surfels, records, example.camera, example.shade, names)
        loss = photometric_loss(rendering.colour, example.image, SSIM_WEIGHT, example.valid, example.emphasis)
        if distortion:
            loss = loss + settings.distortion_weight * rendering.distortion.mean()
        if normals:
            consistency = normal_consistency_loss(rendering.normal, rendering.depth, rendering.alpha, example.camera)
            loss = loss + settings.normal_weight * consistency
        return rendering, example.weight * loss

    def _current_motion(self, state: TrainingState, example: DeviceExample, i: int) -> Float[Tensor, "f 32"]:
        if self.inputs.refines_tracking(i):
            return state.refinement.motion(example.timestep).records.to(self.device)
        return self._examples.copied(self.inputs.subject.sequence.motion(example.timestep, example.level).records)

    def _render(
        self,
        surfels: Surfels,
        records: Float[Tensor, "f 32"],
        camera: Camera,
        shade: Float[Tensor, "f 3"] | None,
        outputs: tuple[str, ...],
        colour: Float[Tensor, "n 3"] | None = None,
    ) -> Rendering:
        """Render the surfels, with their own colours or others."""
        settings, binding = self.inputs.settings, self._binding(surfels)
        eye = camera.centre if surfels.sh_degree > 0 else None
        skinned = skin(
            surfels, binding, self._mesh, records, blend=settings.rig == "jbs", eye=eye,
            rotate_directions=settings.rotate_harmonics,
        )  # fmt: skip
        background = 0.0
        if colour is None:
            factor = None if shade is None else shade[binding]
            colour = seen_colour(surfels.colour, surfels.harmonics, skinned.direction, factor)
            background = self.inputs.subject.supervision.capture.background
        return self._rasterize(WorldSurfels(*skinned[:4], colour), camera, outputs=outputs, background=background)

    def _binding(self, surfels: Surfels) -> Tensor:
        """Triangle of each surfel, on the device."""
        if self._bound[0] is not surfels.binding:
            self._bound = surfels.binding, torch.from_numpy(surfels.binding).long().to(self.device)
        return self._bound[1]

    def image(self, surfels: Surfels, frame: Frame) -> Float[np.ndarray, "h w 3"]:
        """Render a frame at level 0.

        Args:
            surfels: The surfels, on the device.
            frame: The view.

        Returns:
            RGB, not clamped, on the host.
        """
        sequence, camera = self.inputs.subject.sequence, self.inputs.subject.supervision.capture.camera(frame)
        records, shade = map(
            self._examples.copied, (sequence.motion(frame.timestep, 0.0).records, sequence.shade(frame.timestep, 0.0))
        )
        with torch.no_grad():
            return self._render(surfels, records, camera, shade, ("colour",)).colour.cpu().numpy()

    def contribution(self, surfels: Surfels, frame: Frame, level: float) -> Float[np.ndarray, " n"]:
        """Contribution of every surfel to a frame, see `render.contribution`.

        Args:
            surfels: The surfels, on the device.
            frame: The view.
            level: Exaggeration of the mesh.

        Returns:
            Sums in pixels, on the host.
        """
        camera = self.inputs.subject.supervision.capture.camera(frame)
        records = self._examples.copied(self.inputs.subject.sequence.motion(frame.timestep, level).records)
        colour = torch.zeros(len(surfels), 3, device=self.device, requires_grad=True)
        image = self._render(surfels, records, camera, None, ("colour",), colour).colour
        return torch.autograd.grad(image[..., 0].sum(), colour)[0][:, 0].cpu().double().numpy()


def _clear_hidden_gradients(surfels: Surfels, visible: Bool[Tensor, " n"]) -> None:
    """Set the gradients of surfels that no image shows to 0: their numbers may be anything, and 0 times inf is NaN."""
    for _, value in surfels.attributes():
        if value.grad is not None:
            value.grad.masked_fill_(~visible.reshape(-1, *(1,) * (value.ndim - 1)), 0)
