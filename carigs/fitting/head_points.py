"""Points on a posed head and their exact derivatives with respect to the head's parameters."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.rotation_vectors import left_jacobians
from carigs.head import HeadModel, SurfacePoints
from carigs.head.joint_transforms import rotation_matrices


class HeadPoints:
    """Points on the surface of a head, posed by linear blend skinning: `carigs.head.pose` restricted to them.

    Args:
        model: The head model.
        fitted: The parameters.
        points: The points.
    """

    def __init__(self, model: HeadModel, fitted: FittedParameters, points: SurfacePoints) -> None:
        self.fitted, self.barycentric = fitted, points.barycentric
        vertices = points.corners.reshape(-1)
        columns = [fitted.shape, model.num_identity + fitted.expression]
        self.template = model.v_template[vertices].astype(np.float64)
        self.blendshapes = [model.shapedirs[vertices][:, :, chosen].astype(np.float64) for chosen in columns]
        self.posedirs = model.posedirs[vertices].astype(np.float64)
        self.weights = model.weights[vertices].astype(np.float64)
        self.joints = model.joint_template
        self.joint_blendshapes = [model.joint_basis[:, :, chosen] for chosen in columns]
        self.parents = model.parents

    def merged(self) -> HeadPoints:
        """The points as vertices of their own, with the mean of their corners' skinning weights: a third of the work.

        A point of a triangle then moves like a vertex that is bound to the same joints. It differs from the mean of the
        posed corners by the size of the triangle times the change of the weights over it, hundredths of a millimetre.

        Returns:
            The points.
        """
        merged = copy(self)
        mean = self._combine
        merged.barycentric = np.ones((len(self.barycentric), 1))
        merged.template, merged.weights, merged.posedirs = (
            mean(values[None])[0] for values in (self.template, self.weights, self.posedirs)
        )
        merged.blendshapes = [mean(basis[None])[0] for basis in self.blendshapes]
        return merged

    def with_offsets(self, offsets: Float[np.ndarray, "n 3"]) -> HeadPoints:
        """The points of a head whose surface lies elsewhere at each of them.

        Args:
            offsets: Displacements of the points on the template, in metres.

        Returns:
            The points, moved with the skin; joints stay where they are.
        """
        moved = copy(self)
        moved.template = self.template + np.repeat(offsets, self.barycentric.shape[1], axis=0)
        return moved

    def with_expressions(self, corrections: Float[np.ndarray, "n 3 e"]) -> HeadPoints:
        """The points of a head that makes the expressions in its own way.

        Args:
            corrections: Added to the expression blendshapes at each point, in metres per unit of the coefficient.

        Returns:
            The points.
        """
        changed = copy(self)
        repeated = np.repeat(corrections, self.barycentric.shape[1], axis=0)
        changed.blendshapes = [self.blendshapes[0], self.blendshapes[1] + repeated]
        return changed

    def of_person(self, shape: Float[np.ndarray, " s"], joint_offsets: Float[np.ndarray, "j 3"]) -> HeadPoints:
        """The points of a person whose shape is known, and no longer a parameter.

        Args:
            shape: Shape coefficients.
            joint_offsets: Displacements of the joints at rest, in metres.

        Returns:
            The points.
        """
        known = copy(self)
        known.fitted = replace(self.fitted, shape=self.fitted.shape[:0])
        known.template = self.template + self.blendshapes[0] @ shape
        known.joints = self.joints + self.joint_blendshapes[0] @ shape + joint_offsets
        known.blendshapes = [self.blendshapes[0][..., :0], self.blendshapes[1]]
        known.joint_blendshapes = [self.joint_blendshapes[0][..., :0], self.joint_blendshapes[1]]
        return known

    def expressions(self) -> Float[np.ndarray, "n 3 e"]:
        """The expression blendshapes at the points.

        Returns:
            Displacements in metres per unit of the coefficient.
        """
        return self._combine(self.blendshapes[1][None])[0]

    def turned(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> Float[np.ndarray, "t n 3 3"]:
        """Derivatives of the posed points with respect to displacements on the template.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            Blends of the joints' rotations.
        """
        return self._combine(self._pose(frames, shape).blended)

    @property
    def template_points(self) -> Float[np.ndarray, "n 3"]:
        """The points on the template."""
        return self._combine(self.template[None])[0]

    def positions(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> Float[np.ndarray, "t n 3"]:
        """Pose the points.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            World points in metres.
        """
        return self._combine(self._pose(frames, shape).posed)

    def linearise(
        self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]
    ) -> tuple[Float[np.ndarray, "t n 3"], Float[np.ndarray, "t n 3 q"], Float[np.ndarray, "t n 3 s"]]:
        """Pose the points and differentiate them.

        A rotation vector r of joint k turns everything that hangs on the joint about the joint's position p_k by
        G J dr, with the world rotation G of its parent and the derivative J of the exponential map
        (`left_jacobians`). Coefficients move a vertex in its rest frame, and the joints.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            World points, and their derivatives with respect to the parameters of their frame and to the shape.
        """
        pose = self._pose(frames, shape)
        t, m = pose.posed.shape[:2]
        jacobian = np.zeros((t, m, 3, self.fitted.frame_size))
        jacobian[..., :3] = np.eye(3)
        local_jacobians = left_jacobians(pose.vectors)
        first_corrected = len(self.parents) - self.posedirs.shape[2] // 9
        for i, k in enumerate([0, *self.fitted.joints]):
            hanging = self.weights * self._hangs_on(k)
            arm = np.einsum("tmab,tmb->tma", _blended(hanging, pose.rotations), pose.rest)
            arm += _blended(hanging, pose.offsets)
            arm -= hanging.sum(axis=1)[:, None] * pose.joints[:, None, k]
            parent = self.parents[k]
            turn = local_jacobians[:, k] if parent < 0 else pose.rotations[:, parent] @ local_jacobians[:, k]
            column = slice(3 + 3 * i, 6 + 3 * i)
            # The columns of -[arm] turn.
            jacobian[..., column] = np.cross(turn[:, None].swapaxes(-1, -2), arm[:, :, None, :]).swapaxes(-1, -2)
            if k >= first_corrected and self.posedirs.any():
                axes = local_jacobians[:, k].swapaxes(-1, -2)  # rows: how exp(r) turns when a component of r grows
                derivative = np.cross(axes[:, :, None, :], pose.local[:, None, k].swapaxes(-1, -2)).swapaxes(-1, -2)
                directions = self.posedirs[:, :, 9 * (k - first_corrected) :][:, :, :9]
                moved = np.einsum("mie,tae->tmia", directions, derivative.reshape(t, 3, 9))
                jacobian[..., column] += np.einsum("tmij,tmja->tmia", pose.blended, moved)
        jacobian[..., self.fitted.expression_slice] = self._coefficient_jacobian(pose, 1)
        return tuple(map(self._combine, (pose.posed, jacobian, self._coefficient_jacobian(pose, 0))))

    def _coefficient_jacobian(self, pose: _Pose, kind: int) -> Float[np.ndarray, "t m 3 b"]:
        """Derivatives with respect to shape (kind 0) or expression coefficients (kind 1)."""
        blendshapes, joints = self.blendshapes[kind], self.joint_blendshapes[kind]
        moved = [np.broadcast_to(joints[0], (len(pose.posed), *joints[0].shape))]  # of the joints in the world
        for j, parent in enumerate(self.parents[1:], start=1):
            moved.append(moved[parent] + pose.rotations[:, parent] @ (joints[j] - joints[parent]))
        offset = np.stack(moved, axis=1) - pose.rotations @ joints
        return pose.blended @ blendshapes + _blended(self.weights, offset)

    def _pose(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> _Pose:
        expression = frames[:, self.fitted.expression_slice]
        vectors = np.zeros((len(frames), len(self.parents), 3), frames.dtype)
        vectors[:, 0] = frames[:, 3:6]
        vectors[:, self.fitted.joints] = frames[:, self.fitted.joint_slice].reshape(len(frames), -1, 3)
        local = rotation_matrices(vectors)
        shapes, expressions = self.blendshapes
        moved = (expression @ expressions.reshape(-1, expressions.shape[2]).T).reshape(-1, *self.template.shape)
        rest = self.template + shapes @ shape + moved
        if self.posedirs.any():
            corrected = self.posedirs.shape[2] // 9
            feature = (local[:, len(self.parents) - corrected :] - np.eye(3)).reshape(len(frames), -1)
            rest = rest + np.einsum("mif,tf->tmi", self.posedirs, feature)
        shapes, expressions = self.joint_blendshapes
        joints_at_rest = self.joints + shapes @ shape + np.einsum("jib,tb->tji", expressions, expression)
        rotations, joints = [local[:, 0]], [joints_at_rest[:, 0]]
        for j, parent in enumerate(self.parents[1:], start=1):
            rotations.append(rotations[parent] @ local[:, j])
            arm = joints_at_rest[:, j] - joints_at_rest[:, parent]
            joints.append(joints[parent] + np.einsum("tab,tb->ta", rotations[parent], arm))
        world, placed = np.stack(rotations, axis=1), np.stack(joints, axis=1)
        offsets = placed - np.einsum("tjab,tjb->tja", world, joints_at_rest)
        blended = _blended(self.weights, world)
        posed = np.einsum("tmab,tmb->tma", blended, rest) + _blended(self.weights, offsets)
        return _Pose(vectors, local, world, placed, offsets, blended, rest, posed + frames[:, None, :3])

    def _hangs_on(self, joint: int) -> Int[np.ndarray, " j"]:
        """Which joints a joint carries, itself among them."""
        carried = np.zeros(len(self.parents), int)
        for j, parent in enumerate(self.parents):
            carried[j] = j == joint or (parent >= 0 and carried[parent])
        return carried

    def _combine(self, values: Float[np.ndarray, "t m *d"]) -> Float[np.ndarray, "t n *d"]:
        """Weighted means of the corners' values."""
        n, k = self.barycentric.shape
        if k == 1:
            return values
        grouped = values.reshape(len(values), n, k, *values.shape[2:])
        return np.einsum("nk,tnk...->tn...", self.barycentric, grouped)


def _blended(weights: Float[np.ndarray, "m j"], values: Float[np.ndarray, "t j *d"]) -> Float[np.ndarray, "t m *d"]:
    """Sums of the joints' values by the vertices' weights, as one matrix product."""
    t, j, *shape = values.shape
    return (weights @ values.reshape(t, j, -1)).reshape(t, len(weights), *shape)


@dataclass(frozen=True)
class _Pose:
    """What posing computes for t frames and m vertices."""

    vectors: Float[np.ndarray, "t j 3"]
    """Rotation vectors of the joints."""
    local: Float[np.ndarray, "t j 3 3"]
    rotations: Float[np.ndarray, "t j 3 3"]
    """From the joints' rest frames to the world."""
    joints: Float[np.ndarray, "t j 3"]
    """Without the translation, as `offsets`."""
    offsets: Float[np.ndarray, "t j 3"]
    """A vertex x that is bound to joint j alone lies at rotations[j] x + offsets[j]."""
    blended: Float[np.ndarray, "t m 3 3"]
    rest: Float[np.ndarray, "t m 3"]
    posed: Float[np.ndarray, "t m 3"]
