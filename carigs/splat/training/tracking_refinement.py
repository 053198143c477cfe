"""Fine-tuning of the tracked head: pose and expression of every training timestep follow the images' gradient too.

Trackers err by a millimetre or two.  GaussianAvatars lets FLAME's parameters learn along with the splats; here their
gradients are exact: through the surfels, the blended Jacobians and the posed mesh.  Only real frames teach them: GT*
frames are warped from the tracking as it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from carigs.head import HeadModel, HeadParameters
from carigs.head.model import N_JOINTS, N_SHAPE
from carigs.settings import RefineTracking
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.mesh_gradient import differentiable_face_motion
from carigs.splat.training.adam import Adam, as_arrays, restore

CODES = ("translation", "rotation", "neck", "jaw", "eyes", "expression")


class Codes:
    """What is learned of one timestep: the fields of `HeadParameters` named in `CODES`, one row each, float32."""

    def __init__(self, parameters: HeadParameters, used: np.ndarray) -> None:
        for name in CODES:
            value = getattr(parameters, name)
            row = torch.from_numpy((value[used] if name == "expression" else value).astype(np.float32))[None]
            setattr(self, name, row.requires_grad_(True))

    def __len__(self) -> int:
        return 1

    def attributes(self) -> Iterator[tuple[str, Tensor]]:
        """As those of surfels, for `Adam`."""
        return ((name, getattr(self, name)) for name in CODES)


class PosableHead:
    """`carigs.head.pose` in torch, float64: differentiable with respect to the codes."""

    def __init__(self, model: HeadModel) -> None:
        expressions = model.shapedirs[:, :, N_SHAPE:]
        self.used = np.flatnonzero(expressions.any(axis=(0, 1)))
        """Expression codes that move anything."""
        double = {
            name: torch.from_numpy(np.ascontiguousarray(array, np.float64))
            for name, array in (
                ("rest", model.v_template),
                ("expressions", expressions[:, :, self.used]),
                ("correctives", model.posedirs),
                ("regressor", model.joint_regressor),
                ("weights", model.weights),
            )
        }
        self.rest, self.expressions, self.correctives = (double[n] for n in ("rest", "expressions", "correctives"))
        self.regressor, self.weights, self.parents = double["regressor"], double["weights"], model.parents
        self.corrected = bool(model.posedirs.any())

    def pose(self, codes: Codes) -> Float64[Tensor, "v 3"]:
        """World vertices in metres."""
        value = {name: row[0].double() for name, row in codes.attributes()}
        shaped = self.rest + self.expressions @ value["expression"]
        vectors = torch.stack([value["rotation"], value["neck"], value["jaw"], *value["eyes"].reshape(2, 3)])
        turns = torch.linalg.matrix_exp(_cross_matrices(vectors))
        joints = self.regressor @ shaped
        corrected = shaped
        if self.corrected:
            corrected = shaped + self.correctives @ (turns[1:] - torch.eye(3, dtype=torch.float64)).reshape(-1)
        # World from joint by the chain; the joints' places at rest are taken off again.
        turn, place = [turns[0]], [joints[0]]
        for j in range(1, N_JOINTS):
            parent = self.parents[j]
            turn.append(turn[parent] @ turns[j])
            place.append(place[parent] + turn[parent] @ (joints[j] - joints[parent]))
        turn, place = torch.stack(turn), torch.stack(place)
        shift = place - torch.einsum("jik,jk->ji", turn, joints)
        blended = (self.weights @ turn.reshape(N_JOINTS, 9)).reshape(-1, 3, 3)
        posed = (blended @ corrected[:, :, None])[:, :, 0] + self.weights @ shift
        return posed + value["translation"]


def _cross_matrices(vectors: Float64[Tensor, "n 3"]) -> Float64[Tensor, "n 3 3"]:
    x, y, z = vectors.T
    none = torch.zeros_like(x)
    return torch.stack([none, -z, y, z, none, -x, -y, x, none], dim=1).reshape(-1, 3, 3)


class TrackingRefinement:
    """The codes of every training timestep and their optimiser, beside a `HeadSequence` that is kept up to date."""

    def __init__(self, performance: HeadSequence, timesteps: list[int]) -> None:
        self.performance = performance
        self.head = PosableHead(performance.head)
        self.codes = {t: Codes(performance.parameters[t], self.head.used) for t in timesteps}
        self.adam = {t: Adam(codes) for t, codes in self.codes.items()}

    def motion(self, timestep: int) -> FaceMotion:
        """Of the natural head, differentiable with respect to the timestep's codes."""
        for _, row in self.codes[timestep].attributes():
            row.grad = None
        return differentiable_face_motion(self.performance.rig, self.head.pose(self.codes[timestep]))

    def step(self, timestep: int, settings: RefineTracking) -> None:
        """Move the codes down the gradient that a backward pass has left."""
        rates = dict.fromkeys(CODES, settings.rotation_lr)
        rates |= {"translation": settings.translation_lr, "expression": settings.expression_lr}
        self.adam[timestep].step(self.codes[timestep], rates)
        self._publish(timestep)

    def _publish(self, timestep: int) -> None:
        before = self.performance.parameters[timestep]
        values = {name: row.detach().numpy()[0].astype(np.float64) for name, row in self.codes[timestep].attributes()}
        expression = before.expression.copy()
        expression[self.head.used] = values["expression"]
        self.performance.move(timestep, replace(before, **{**values, "expression": expression}))

    def as_arrays(self) -> dict[str, np.ndarray]:
        """The state by name, for checkpoints."""
        arrays = {}
        for t, codes in self.codes.items():
            arrays[f"tune_{t}_steps"] = np.array(self.adam[t].steps)
            state = as_arrays(self.adam[t]) | {name: row.detach().numpy() for name, row in codes.attributes()}
            arrays |= {f"tune_{t}_{name}": value for name, value in state.items()}
        return arrays

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Go on from what `as_arrays` gave."""
        for t, codes in self.codes.items():
            own = {k.removeprefix(f"tune_{t}_"): v for k, v in arrays.items() if k.startswith(f"tune_{t}_")}
            for name, row in codes.attributes():
                row.data.copy_(torch.from_numpy(own[name]))
            restore(self.adam[t], int(own["steps"]), own)
            self._publish(t)
