"""Head models: template, blendshapes and skinning, in files of FLAME's format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.head.flame_files import complete_flame, read_flame
from carigs.head.gnm import gnm_arrays, is_gnm
from carigs.head.model_arrays import FLAME_JOINTS, FLAME_NUM_IDENTITY, RestJoints, checked_fields
from carigs.head.surface_points import SurfacePoints
from carigs.head.teeth import FLAME_COUNTS, LOWER_LIP, UPPER_LIP, is_upper_tooth, teeth_faces, teeth_vertices
from carigs.readers.formats import Format, check_npz_format
from carigs.readers.npz import read_npz

FORMAT = Format("carigs-head", 1, "convert it again, with carigs head")
MAX_BYTES = 1 << 30
"""Largest sum of the arrays of a model, in bytes; GNM's have less than 0.2 GB."""


@dataclass(frozen=True)
class HeadModel:
    """A linear-blend-skinned head with any numbers of joints and blendshapes; defaults are those of FLAME.

    Arrays are float32 as stored, lengths are in metres. The formulas are in `carigs.head.posing`.
    """

    v_template: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    shapedirs: Float[np.ndarray, "v 3 b"]
    """Identity blendshapes, then expression blendshapes."""
    posedirs: Float[np.ndarray, "v 3 p"]
    """Pose correctives for the 9 entries of R - I, row-major, of each of the last p / 9 joints; of FLAME's all joints
    but the root."""
    joint_regressor: Float[np.ndarray, "j v"]
    """Joints as weighted sums of vertices."""
    weights: Float[np.ndarray, "v j"]
    """Skinning weights."""
    parents: Int[np.ndarray, " j"]
    """Parent joint of each joint; -1 for the root, which is the first."""
    num_identity: int = FLAME_NUM_IDENTITY
    """Number of identity blendshapes."""
    joint_names: tuple[str, ...] = FLAME_JOINTS
    rest_joints: RestJoints | None = None
    """Joints of the shaped head, where the model has its own; None: regressed from the shaped vertices. Offsets of
    vertices move the joints by the regressor in both cases."""
    regions: Mapping[str, Int[np.ndarray, " _"]] = field(default_factory=dict)
    """Vertex indices by FLAME_masks' region names."""
    expression_names: tuple[str, ...] = ()
    landmarks68: SurfacePoints | None = None
    """The 68 iBUG landmarks, if the file has them."""

    @property
    def num_expressions(self) -> int:
        """Number of expression blendshapes."""
        return self.shapedirs.shape[2] - self.num_identity

    @property
    def identity_basis(self) -> Float[np.ndarray, "v 3 i"]:
        """Identity blendshapes."""
        return self.shapedirs[:, :, : self.num_identity]

    @property
    def expression_basis(self) -> Float[np.ndarray, "v 3 e"]:
        """Expression blendshapes."""
        return self.shapedirs[:, :, self.num_identity :]

    @cached_property
    def expression_rows(self) -> Float[np.ndarray, "e m"]:
        """Expression blendshapes as rows of m = 3 v numbers that lie side by side in memory, which are summed fast."""
        return _as_rows(self.expression_basis)

    @cached_property
    def corrective_rows(self) -> Float[np.ndarray, "p m"]:
        """Pose correctives in the same way; no rows if all are 0."""
        return _as_rows(self.posedirs if self.posedirs.any() else self.posedirs[:, :, :0])

    @cached_property
    def shaped_templates(self) -> dict[bytes, Float[np.ndarray, "v 3"]]:
        """Template and identity blendshapes of the last subject that was posed, by its coefficients."""
        return {}

    @cached_property
    def joint_template(self) -> Float[np.ndarray, "j 3"]:
        """Joints of the template, in float64."""
        if self.rest_joints is not None:
            return self.rest_joints.template.astype(np.float64)
        return self.joint_regressor.astype(np.float64) @ self.v_template

    @cached_property
    def joint_basis(self) -> Float[np.ndarray, "j 3 b"]:
        """Blendshapes of the joints, in float64: regressing is linear, so J (T + B beta) = J T + (J B) beta."""
        if self.rest_joints is not None:
            return self.rest_joints.basis.astype(np.float64)
        used = np.flatnonzero(self.joint_regressor.any(axis=0))  # few vertices make a joint
        regressor = self.joint_regressor[:, used].astype(np.float64)
        # Not a product of matrices, whose rounding depends on the number of BLAS threads.
        return np.einsum("ju,ucb->jcb", regressor, self.shapedirs[used], optimize=False)

    @classmethod
    def load(cls, file: str | Path) -> HeadModel:
        """Read a model; FLAME gets teeth, and the regions that its files lack.

        Args:
            file: An .npz of FLAME's arrays or of GNM, or FLAME's .pkl with its regions and landmarks beside
                it (`carigs.head.flame_files`).

        Returns:
            The model.

        Raises:
            InputError: If the file is missing or cannot be read, or an array is missing or not valid.
        """
        file = Path(file)
        arrays = read_flame(file) if file.suffix == ".pkl" else read_npz(file, "head model", limit=MAX_BYTES)
        check_npz_format(arrays, FORMAT, file, unstated="carigs-head-1")  # FLAME's and GNM's state none
        if is_gnm(arrays):
            arrays = gnm_arrays(arrays, file)
        return cls(**complete_flame(checked_fields(arrays, file), file)).with_teeth()

    def with_teeth(self) -> HeadModel:
        """Add teeth to FLAME, behind its vertices and faces.

        They move with the neck and the jaw joint, and their identity blendshapes are those of the lips in front of
        them.

        Returns:
            The model with teeth; the same model if it is not FLAME without teeth.
        """
        if (len(self.v_template), len(self.faces)) != FLAME_COUNTS or self.joint_names != FLAME_JOINTS:
            return self
        v, upper = FLAME_COUNTS[0], is_upper_tooth()
        weights = np.zeros((len(upper), len(self.parents)), np.float32)
        weights[np.arange(len(upper)), np.where(upper, 1, 2)] = 1  # neck, jaw
        identity = (self.identity_basis[list(UPPER_LIP)] + self.identity_basis[list(LOWER_LIP)]) / 2
        shapedirs = np.zeros((len(upper), *self.shapedirs.shape[1:]), np.float32)
        shapedirs[:, :, : self.num_identity] = np.tile(identity, (len(upper) // len(identity), 1, 1))
        ids = v + np.arange(len(upper))
        return replace(
            self,
            v_template=np.concatenate([self.v_template, teeth_vertices(self.v_template).astype(np.float32)]),
            faces=np.concatenate([self.faces, v + teeth_faces().astype(self.faces.dtype)]),
            shapedirs=np.concatenate([self.shapedirs, shapedirs]),
            posedirs=np.concatenate([self.posedirs, np.zeros((len(upper), *self.posedirs.shape[1:]), np.float32)]),
            joint_regressor=np.pad(self.joint_regressor, ((0, 0), (0, len(upper)))),
            weights=np.concatenate([self.weights, weights]),
            regions={**self.regions, "teeth": ids, "teeth_upper": ids[upper], "teeth_lower": ids[~upper]},
        )

    def save(self, file: str | Path) -> None:
        """Write the .npz form.

        Args:
            file: File to create or replace.
        """
        np.savez_compressed(file, format=str(FORMAT), **self.arrays())  # most of the 400 blendshapes are zero

    def arrays(self) -> dict[str, np.ndarray]:
        """The model as arrays by FLAME's names; `carigs.head.model_arrays.checked_fields` is the inverse.

        Returns:
            The arrays of the .npz form.
        """
        arrays = {
            "v_template": self.v_template,
            "f": self.faces.astype(np.uint32),
            "shapedirs": self.shapedirs,
            "posedirs": self.posedirs,
            "J_regressor": self.joint_regressor,
            "weights": self.weights,
            "kintree_table": np.stack([self.parents, np.arange(len(self.parents))]),
            **{f"mask_{name}": ids for name, ids in self.regions.items()},
        }
        if self.num_identity != FLAME_NUM_IDENTITY:
            arrays["num_identity"] = np.array(self.num_identity)
        if self.joint_names != FLAME_JOINTS:
            arrays["joint_names"] = np.array(self.joint_names)
        if self.rest_joints is not None:
            arrays |= {"joint_template": self.rest_joints.template, "joint_basis": self.rest_joints.basis}
        if self.expression_names:
            arrays["expression_names"] = np.array(self.expression_names)
        if self.landmarks68 is not None:
            arrays |= self.landmarks68.arrays("landmarks68")
        return arrays

    def vertex_region(self, *names: str) -> Bool[np.ndarray, " v"]:
        """Vertices of regions.

        Args:
            *names: Names of regions; those that the model lacks are empty.

        Returns:
            Whether each vertex lies in one of the regions.
        """
        inside = np.zeros(len(self.v_template), bool)
        for name in names:
            inside[self.regions.get(name, [])] = True
        return inside

    def face_region(self, *names: str) -> Bool[np.ndarray, " f"]:
        """Faces of regions.

        Args:
            *names: Names of regions; those that the model lacks are empty.

        Returns:
            Whether all three corners of each face lie in one and the same of the regions.
        """
        inside = np.zeros(len(self.faces), bool)
        for name in names:
            inside |= self.vertex_region(name)[self.faces].all(axis=1)
        return inside


def _as_rows(blendshapes: Float[np.ndarray, "v 3 b"]) -> Float[np.ndarray, "b m"]:
    v, axes, b = blendshapes.shape
    return np.ascontiguousarray(blendshapes.reshape(v * axes, b).T)
