"""Head model files in FLAME's format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import InputError
from carigs.head.flame_pickle import read_flame_pickle
from carigs.head.teeth import FLAME_COUNTS, LOWER_LIP, UPPER_LIP, is_upper_tooth, teeth_faces, teeth_vertices
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz

N_SHAPE = 300  # FLAME's convention: columns 0..299 of `shapedirs` are identity, the rest expression
N_JOINTS = 5  # root, neck, jaw, left eye, right eye


@dataclass(frozen=True)
class HeadModel:
    """Template, blendshapes and skinning of a head (Li et al. 2017, FLAME), float32 as stored; lengths in metres."""

    v_template: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    shapedirs: Float[np.ndarray, "v 3 b"]
    """Identity blendshapes in columns 0..299, expression blendshapes after them."""
    posedirs: Float[np.ndarray, "v 3 36"]
    """Pose correctives for the 4 x 9 entries of R_neck - I, R_jaw - I, R_left_eye - I, R_right_eye - I, row-major."""
    joint_regressor: Float[np.ndarray, "5 v"]
    weights: Float[np.ndarray, "v 5"]
    """Skinning weights."""
    parents: Int[np.ndarray, "5"]
    """Parent joint of each joint; -1 for the root."""
    regions: Mapping[str, Int[np.ndarray, " _"]] = field(default_factory=dict)
    """Vertex indices by FLAME_masks' region names."""
    expression_names: tuple[str, ...] = ()
    landmarks68: Int[np.ndarray, "68"] | None = None
    """Vertex indices of the 68 iBUG landmarks, if the file has them."""

    @classmethod
    def load(cls, file: str | Path) -> HeadModel:
        """Read a model; FLAME gets teeth.

        Args:
            file: An .npz, or FLAME's .pkl with its regions in `FLAME_masks.pkl` beside it.

        Returns:
            The model.

        Raises:
            InputError: If the file is missing or cannot be read, or an array is missing or not valid.
        """
        file = Path(file)
        arrays = read_flame_pickle(file) if file.suffix == ".pkl" else read_npz(file, "head model")
        return _checked_model(arrays, file).with_teeth()

    def with_teeth(self) -> HeadModel:
        """Add teeth to FLAME, behind its vertices and faces.

        They move with the neck and the jaw joint, and their identity blendshapes are those of the lips in front of
        them.

        Returns:
            The model with teeth; the same model if it is not FLAME without teeth.
        """
        if (len(self.v_template), len(self.faces)) != FLAME_COUNTS:
            return self
        v, upper = FLAME_COUNTS[0], is_upper_tooth()
        weights = np.zeros((len(upper), N_JOINTS), np.float32)
        weights[np.arange(len(upper)), np.where(upper, 1, 2)] = 1  # neck, jaw
        identity = (self.shapedirs[list(UPPER_LIP), :, :N_SHAPE] + self.shapedirs[list(LOWER_LIP), :, :N_SHAPE]) / 2
        shapedirs = np.zeros((len(upper), *self.shapedirs.shape[1:]), np.float32)
        shapedirs[:, :, :N_SHAPE] = np.tile(identity, (len(upper) // len(identity), 1, 1))
        ids = v + np.arange(len(upper))
        return replace(
            self,
            v_template=np.concatenate([self.v_template, teeth_vertices(self.v_template).astype(np.float32)]),
            faces=np.concatenate([self.faces, v + teeth_faces().astype(self.faces.dtype)]),
            shapedirs=np.concatenate([self.shapedirs, shapedirs]),
            posedirs=np.concatenate([self.posedirs, np.zeros((len(upper), 3, 36), np.float32)]),
            joint_regressor=np.pad(self.joint_regressor, ((0, 0), (0, len(upper)))),
            weights=np.concatenate([self.weights, weights]),
            regions={**self.regions, "teeth": ids, "teeth_upper": ids[upper], "teeth_lower": ids[~upper]},
        )

    def save(self, file: str | Path) -> None:
        """Write the .npz form.

        Args:
            file: File to create or replace.
        """
        extra = {} if self.landmarks68 is None else {"landmarks68": self.landmarks68}
        if self.expression_names:
            extra["expression_names"] = np.array(self.expression_names)
        np.savez_compressed(  # most of the 400 blendshapes are zero
            file,
            v_template=self.v_template,
            f=self.faces.astype(np.uint32),
            shapedirs=self.shapedirs,
            posedirs=self.posedirs,
            J_regressor=self.joint_regressor,
            weights=self.weights,
            kintree_table=np.stack([self.parents, np.arange(N_JOINTS)]),
            **{f"mask_{name}": ids for name, ids in self.regions.items()},
            **extra,
        )

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


def _checked_model(arrays: Mapping[str, Any], file: Path) -> HeadModel:
    dense = {name: value.toarray() if hasattr(value, "toarray") else value for name, value in arrays.items()}

    def take(name: str, shape: tuple[int | None, ...], dtype: type, below: int | None = None) -> np.ndarray:
        return checked_array(dense, name, shape, dtype, below=below, file=file)

    v_template = take("v_template", (None, 3), np.float32)
    v = len(v_template)
    faces = take("f", (None, 3), np.int32, below=v)
    if len(faces) == 0:
        raise InputError("holds no faces", file=file, field="f")
    parents = take("kintree_table", (2, N_JOINTS), np.int64)[0].copy()
    parents[0] = -1
    if (parents[1:] < 0).any() or (parents[1:] >= np.arange(1, N_JOINTS)).any():
        raise InputError("each joint must come after its parent", file=file, field="kintree_table")
    shapedirs = take("shapedirs", (v, 3, None), np.float32)
    if shapedirs.shape[2] <= N_SHAPE:
        problem = f"{shapedirs.shape[2]} columns; {N_SHAPE} identity columns and at least one expression are expected"
        raise InputError(problem, file=file, field="shapedirs")
    regions = {}
    for name in arrays:
        if name.startswith("mask_"):
            regions[name.removeprefix("mask_")] = take(name, (None,), np.int64, below=v)
    return HeadModel(
        v_template=v_template,
        faces=faces,
        shapedirs=shapedirs,
        posedirs=take("posedirs", (v, 3, 36), np.float32),
        joint_regressor=take("J_regressor", (N_JOINTS, v), np.float32),
        weights=take("weights", (v, N_JOINTS), np.float32),
        parents=parents,
        regions=regions,
        expression_names=tuple(str(name) for name in np.asarray(arrays.get("expression_names", ()))),
        landmarks68=take("landmarks68", (68,), np.int64, below=v) if "landmarks68" in arrays else None,
    )
