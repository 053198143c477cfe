"""Head model files in FLAME's format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import InputError
from carigs.head.flame_pickle import read_pickle

N_SHAPE = 300  # FLAME's convention: columns 0..299 of `shapedirs` are identity, the rest expression
N_JOINTS = 5  # root, neck, jaw, left eye, right eye


@dataclass(frozen=True)
class HeadModel:
    """Template, blendshapes and skinning of a head, float32 as stored; lengths in metres."""

    v_template: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    shapedirs: Float[np.ndarray, "v 3 b"]
    """Identity directions in columns 0..299, expression directions after them."""
    posedirs: Float[np.ndarray, "v 3 36"]
    """Pose correctives for the 4 x 9 entries of R_neck - I, R_jaw - I, R_left_eye - I, R_right_eye - I, row-major."""
    joint_regressor: Float[np.ndarray, "5 v"]
    weights: Float[np.ndarray, "v 5"]
    parents: Int[np.ndarray, "5"]
    """Parent joint of each joint; -1 for the root."""
    regions: Mapping[str, Int[np.ndarray, "_"]] = field(default_factory=dict)
    """Vertex ids by FLAME_masks' region names."""
    expression_names: tuple[str, ...] = ()
    landmarks68: Int[np.ndarray, "68"] | None = None
    """Vertex ids of the 68 iBUG landmarks, where the file brings them."""

    @classmethod
    def load(cls, file: str | Path) -> HeadModel:
        """Read a model from .npz or FLAME's .pkl (regions from `FLAME_masks.pkl` beside it); FLAME gets teeth.

        Raises `InputError` for a missing or unreadable file, a missing array, or an array of another shape.
        """
        file = Path(file)
        if not file.is_file():
            raise InputError("no such head model", file=file)
        from carigs.head.teeth import with_teeth  # which needs this module

        arrays = read_pickle(file) if file.suffix == ".pkl" else _read_npz(file)
        return with_teeth(_checked(arrays, file))

    def save(self, file: str | Path) -> None:
        """Write the .npz form."""
        extra = {} if self.landmarks68 is None else {"landmarks68": self.landmarks68}
        if self.expression_names:
            extra["expression_names"] = np.array(self.expression_names)
        np.savez_compressed(  # most of the 400 directions are zero
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

    def vertex_region(self, *names: str) -> Bool[np.ndarray, "v"]:
        """Whether each vertex lies in one of the named regions; names that the model lacks hold nothing."""
        inside = np.zeros(len(self.v_template), bool)
        for name in names:
            inside[self.regions.get(name, [])] = True
        return inside

    def face_region(self, *names: str) -> Bool[np.ndarray, "f"]:
        """Whether all three corners of each face lie in one of the named regions."""
        inside = np.zeros(len(self.faces), bool)
        for name in names:
            inside |= self.vertex_region(name)[self.faces].all(axis=1)
        return inside


def _read_npz(file: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError) as error:
        raise InputError(f"not a readable .npz head model ({error})", file=file) from error


def _checked(arrays: Mapping[str, object], file: Path) -> HeadModel:
    def take(name: str, shape: tuple[int | None, ...], dtype: type) -> np.ndarray:
        if name not in arrays:
            raise InputError("this array is missing from the head model", file=file, field=name)
        value = arrays[name]
        array = np.asarray(value.toarray() if hasattr(value, "toarray") else value).astype(dtype)
        if len(array.shape) != len(shape) or any(
            want not in (None, have) for want, have in zip(shape, array.shape, strict=True)
        ):
            wanted = " x ".join("*" if n is None else str(n) for n in shape)
            raise InputError(f"shape {array.shape}, expected {wanted}", file=file, field=name)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise InputError(f"not a finite number at {index}", file=file, field=name)
        return array

    v_template = take("v_template", (None, 3), np.float32)
    v = len(v_template)
    faces = take("f", (None, 3), np.int32)
    if len(faces) == 0 or faces.min() < 0 or faces.max() >= v:
        raise InputError(f"face indices must lie in 0..{v - 1}", file=file, field="f")
    parents = take("kintree_table", (2, N_JOINTS), np.int64)[0].copy()
    parents[0] = -1
    if (parents[1:] < 0).any() or (parents[1:] >= np.arange(1, N_JOINTS)).any():
        raise InputError("each joint must come after its parent", file=file, field="kintree_table")
    shapedirs = take("shapedirs", (v, 3, None), np.float32)
    if shapedirs.shape[2] <= N_SHAPE:
        raise InputError(
            f"{shapedirs.shape[2]} columns; {N_SHAPE} identity columns and at least one expression are expected",
            file=file,
            field="shapedirs",
        )
    regions = {}
    for name in arrays:
        if name.startswith("mask_"):
            ids = take(name, (None,), np.int64)
            if len(ids) and (ids.min() < 0 or ids.max() >= v):
                raise InputError(f"vertex ids must lie in 0..{v - 1}", file=file, field=name)
            regions[name.removeprefix("mask_")] = ids
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
        landmarks68=take("landmarks68", (68,), np.int64) if "landmarks68" in arrays else None,
    )
