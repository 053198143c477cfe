"""Refinement of the tracked head: pose and expression of every training timestep are optimised with the surfels.

Trackers have errors of a millimetre or two. As in GaussianAvatars (Qian et al. 2024) the head parameters are learned
with the splats; the gradients here are exact, through the surfels, the blended Jacobians and the posed mesh. Only real
frames are used: GT* frames are warped with the parameters as they were tracked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64, Int
from torch import Tensor

from carigs.head import HeadModel, HeadParameters
from carigs.settings import RefineTracking
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.joint_chain import joint_chain
from carigs.splat.rig.linear_blend import linear_blend_skinning
from carigs.splat.rig.mesh_gradient import differentiable_face_motion
from carigs.splat.training.adam import Adam

REFINED = ("translation", "rotation", "joints", "expression")
"""Fields of `HeadParameters` that are refined."""
ARM = 0.1
"""Distance from a joint in metres at which a rotation by its learning rate moves as far as the translation by its."""


class RefinedParameters:
    """Head parameters of one timestep as float32 tensors of one row, in the form that `Adam` takes.

    Args:
        parameters: Initial values.
        used: Expression coefficients that move anything.
    """

    def __init__(self, parameters: HeadParameters, used: Int[np.ndarray, " n"]) -> None:
        self.rows = {}
        for name in REFINED:
            value = getattr(parameters, name)
            row = torch.from_numpy((value[used] if name == "expression" else value).astype(np.float32)).reshape(1, -1)
            self.rows[name] = row.requires_grad_(True)
        offset = parameters.dynamic_offset
        self.offset = None if offset is None else torch.from_numpy(offset.astype(np.float64))
        """Added to the shaped head of this timestep; not refined."""

    def __len__(self) -> int:
        return 1

    def attributes(self) -> Iterator[tuple[str, Tensor]]:
        """Name and tensor of every field.

        Returns:
            Pairs, in the order of `REFINED`.
        """
        return iter(self.rows.items())


class DifferentiableHead:
    """Head model in PyTorch: `carigs.head.pose` in float64, differentiable with respect to the parameters.

    Args:
        model: The head model, with the identity baked into its template.
    """

    def __init__(self, model: HeadModel) -> None:
        self.used = np.flatnonzero(model.expression_basis.any(axis=(0, 1)))
        """Expression coefficients that move anything."""
        columns = model.num_identity + self.used
        self.template, self.joint_template, self.joint_basis, self.joint_regressor, self.weights = map(
            _tensor,
            (model.v_template, model.joint_template, model.joint_basis[:, :, columns], model.joint_regressor,
             model.weights),
        )  # fmt: skip
        # One row for each blendshape: products with the rows of (v, 3, b) take twice as long.
        self.expressions, self.posedirs = map(_rows, (model.shapedirs[:, :, columns], model.posedirs))
        self.parents = model.parents
        self.has_posedirs = bool(model.posedirs.any())

    def pose(self, parameters: RefinedParameters) -> Float64[Tensor, "v 3"]:
        """Pose the head by linear blend skinning (FLAME, Li et al. 2017).

        Args:
            parameters: Head parameters.

        Returns:
            World vertices in metres.
        """
        value = {name: row[0].double() for name, row in parameters.attributes()}
        shaped = self.template + (self.expressions.T @ value["expression"]).reshape(-1, 3)
        joints = self.joint_template + self.joint_basis @ value["expression"]
        if parameters.offset is not None:
            shaped = shaped + parameters.offset
            joints = joints + self.joint_regressor @ parameters.offset
        vectors = torch.cat([value["rotation"], value["joints"]]).reshape(-1, 3)
        local, transforms = joint_chain(vectors, joints, self.parents)
        if self.has_posedirs:
            last = local[len(local) - len(self.posedirs) // 9 :] - torch.eye(3, dtype=torch.float64)
            shaped = shaped + (self.posedirs.T @ last.reshape(-1)).reshape(-1, 3)
        return linear_blend_skinning(shaped, transforms, self.weights) + value["translation"]


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float64))


def _rows(blendshapes: np.ndarray) -> Tensor:
    return _tensor(blendshapes.reshape(3 * len(blendshapes), blendshapes.shape[2]).T)


class TrackingRefinement:
    """Refined parameters of every training timestep and their optimisers; updates a `HeadSequence` after each step.

    Args:
        sequence: The subject; its parameters change.
        timesteps: Timesteps to refine.
    """

    def __init__(self, sequence: HeadSequence, timesteps: list[int]) -> None:
        self.sequence = sequence
        self.head = DifferentiableHead(sequence.head)
        self.parameters = {t: RefinedParameters(sequence.parameters[t], self.head.used) for t in timesteps}
        self.adam = {t: Adam(parameters) for t, parameters in self.parameters.items()}

    def motion(self, timestep: int) -> FaceMotion:
        """Motion of the natural head, differentiable with respect to the parameters of the timestep.

        Args:
            timestep: Timestep of the capture; its gradients are cleared.

        Returns:
            The motion; its records are a tensor.
        """
        for _, row in self.parameters[timestep].attributes():
            row.grad = None
        return differentiable_face_motion(
            self.sequence.rig, self.head.pose(self.parameters[timestep]), self.sequence.smooth, self.sequence.solids
        )

    def step(self, timestep: int, settings: RefineTracking) -> None:
        """Update the parameters of a timestep by the gradients of the last backward pass.

        Args:
            timestep: Timestep of the capture.
            settings: Learning rates.
        """
        rates = dict.fromkeys(REFINED, settings.translation_lr / ARM)
        rates |= {"translation": settings.translation_lr, "expression": settings.expression_lr}
        self.adam[timestep].step(self.parameters[timestep], rates)
        self._update_sequence(timestep)

    def _update_sequence(self, timestep: int) -> None:
        before = self.sequence.parameters[timestep]
        rows = self.parameters[timestep].attributes()
        values = {name: row.detach().numpy()[0].astype(np.float64) for name, row in rows}
        expression = before.expression.copy()
        expression[self.head.used] = values["expression"]
        values |= {"expression": expression, "joints": values["joints"].reshape(-1, 3)}
        self.sequence.set_parameters(timestep, replace(before, **values))

    def as_arrays(self) -> dict[str, np.ndarray]:
        """The state, for a checkpoint.

        Returns:
            Arrays by name.
        """
        arrays = {}
        for t, parameters in self.parameters.items():
            values = {name: row.detach().numpy() for name, row in parameters.attributes()}
            state = {"steps": np.array(self.adam[t].steps)} | self.adam[t].as_arrays() | values
            arrays |= {f"tune_{t}_{name}": value for name, value in state.items()}
        return arrays

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Set the state, and the parameters of the sequence.

        Args:
            arrays: Result of `as_arrays`.
        """
        for t, parameters in self.parameters.items():
            own = {k.removeprefix(f"tune_{t}_"): v for k, v in arrays.items() if k.startswith(f"tune_{t}_")}
            for name, row in parameters.attributes():
                row.data.copy_(torch.from_numpy(own[name]))
            self.adam[t].restore(int(own["steps"]), own)
            self._update_sequence(t)
