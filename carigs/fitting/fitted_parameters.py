"""Which parameters of a head model are fitted, and how they are put into one vector per frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from carigs.head import HeadModel, HeadParameters

LEAST_WEIGHT = 0.01
"""Skinning weight below which a joint does not move a point."""


@dataclass(frozen=True)
class FittedParameters:
    """The parameters of a head that are fitted; all others are 0.

    The vector of a frame holds the translation (3), the rotation of the root (3), the rotations of other joints (3
    each), and expression coefficients. The shape coefficients are a second vector, which all frames share.
    """

    shape: Int[np.ndarray, " s"]
    """Columns of the identity basis."""
    expression: Int[np.ndarray, " e"]
    """Columns of the expression basis."""
    joints: Int[np.ndarray, " j"]
    """Joints other than the root."""

    @property
    def frame_size(self) -> int:
        """Length of the vector of a frame."""
        return 6 + 3 * len(self.joints) + len(self.expression)

    @property
    def joint_slice(self) -> slice:
        """The rotations of joints other than the root in the vector of a frame."""
        return slice(6, 6 + 3 * len(self.joints))

    @property
    def expression_slice(self) -> slice:
        """The expression coefficients in the vector of a frame."""
        return slice(6 + 3 * len(self.joints), None)

    def head_parameters(
        self, model: HeadModel, frame: Float[np.ndarray, " q"], shape: Float[np.ndarray, " s"]
    ) -> HeadParameters:
        """Head parameters of a frame.

        Args:
            model: The head model.
            frame: Parameters of the frame.
            shape: Shape coefficients.

        Returns:
            The parameters.
        """
        parameters = HeadParameters.zeros(model)
        parameters.translation[:], parameters.rotation[:] = frame[:3], frame[3:6]
        parameters.joints[self.joints - 1] = frame[self.joint_slice].reshape(-1, 3)
        parameters.shape[self.shape] = shape
        parameters.expression[self.expression] = frame[self.expression_slice]
        return parameters


def fitted_parameters(
    model: HeadModel, observed: Int[np.ndarray, " n"], *, max_shape: int = 100, max_expression: int = 100
) -> FittedParameters:
    """Choose what is fitted: the blendshapes that move the head most, and the joints that move observed vertices.

    Args:
        model: The head model.
        observed: Vertices.
        max_shape: Largest number of identity blendshapes.
        max_expression: Largest number of expression blendshapes.

    Returns:
        The parameters, with columns in ascending order.
    """
    carried = model.weights[observed].astype(np.float64)
    for joint in range(len(model.parents) - 1, 0, -1):  # what moves a joint moves all joints that hang on it
        carried[:, model.parents[joint]] += carried[:, joint]
    joints = 1 + np.flatnonzero((carried[:, 1:] > LEAST_WEIGHT).any(axis=0))
    return FittedParameters(
        _largest(model.identity_basis, max_shape), _largest(model.expression_basis, max_expression), joints
    )


def _largest(basis: Float[np.ndarray, "v 3 b"], count: int) -> Int[np.ndarray, " k"]:
    """The columns of the largest displacements, without those that are 0."""
    energy = np.einsum("vib,vib->b", basis, basis)
    order = np.argsort(-energy, kind="stable")[:count]
    return np.sort(order[energy[order] > 0])
