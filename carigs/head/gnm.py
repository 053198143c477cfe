"""GNM Head (https://github.com/google/GNM, Apache-2.0): its .npz as the arrays of a head model.

Forward model (its formal definition): the rest pose is template + identity + expression, the joints are template +
identity; pose correctives for R - I of every joint are added; linear blend skinning; translation.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import InputError
from carigs.head.region_geometry import FacialPoints, geometric_regions
from carigs.readers.arrays import checked_array

GROUPS = {
    "face": ("hockey_mask",),
    "forehead": ("forehead_region",),
    "brows": ("left_brow_region", "right_brow_region"),
    "nose": ("nose_region",),
    "lips": ("upper_lip", "lower_lip"),
    "lip_inside": ("mouth_sock",),
    "eye_region": ("left_orbital_region", "right_orbital_region"),
    "left_eye_region": ("left_orbital_region",),
    "right_eye_region": ("right_orbital_region",),
    "left_eyeball": ("left_eye",),
    "right_eyeball": ("right_eye",),
    "teeth": ("teeth",),
    "teeth_upper": ("upper_teeth_and_gums",),
    "teeth_lower": ("lower_teeth_and_gums",),
    "tongue": ("tongue",),
}
"""Vertex groups of GNM that make a region of FLAME_masks, or of those that carigs has besides."""
SIDED = {"ear": "ears", "eyelid": "eye_sockets"}
"""Regions with a left and a right part: groups that GNM divides by its groups `left` and `right`."""
SKIN = ("face", "left_ear", "right_ear", "left_eyelid", "right_eyelid")
"""Regions of the visible skin alone; the groups reach into eyes and mouth."""
MIN_WEIGHT = 0.5
"""A vertex with this weight belongs to a group."""


def is_gnm(arrays: Mapping[str, Any]) -> bool:
    """Whether arrays are those of GNM.

    Args:
        arrays: Arrays by name.

    Returns:
        Whether they have GNM's names.
    """
    return "template_vertex_positions" in arrays


def gnm_arrays(arrays: Mapping[str, Any], file: Path) -> dict[str, np.ndarray]:
    """Convert GNM's arrays to those of `carigs.head.model_arrays`.

    Args:
        arrays: GNM's arrays: bases of shape (blendshapes, vertices, 3), weights of shape (joints, vertices), pose
            correctives of shape (9 joints, 3 vertices).
        file: Where they come from, for messages.

    Returns:
        The arrays by FLAME's names.

    Raises:
        InputError: If an array is missing, of another shape or kind, or holds a value that is not possible.
    """

    def take(name: str, *shape: int | None, dtype: Any = np.float32, below: int | None = None) -> np.ndarray:
        return checked_array(arrays, name, shape, dtype, below=below, file=file)

    template = take("template_vertex_positions", None, 3)
    joints = take("template_joint_positions", None, 3)
    v, j = len(template), len(joints)
    if v == 0:  # the sizes of the other arrays would mean nothing
        raise InputError("holds no vertices", file=file, field="template_vertex_positions")
    identity = take("vertex_identity_basis", None, v, 3)
    joint_identity = take("joint_identity_basis", len(identity), j, 3)
    expression = take("expression_basis", None, v, 3)
    i, b = len(identity), len(identity) + len(expression)
    shapedirs = np.empty((v, 3, b), np.float32)
    shapedirs[:, :, :i], shapedirs[:, :, i:] = identity.transpose(1, 2, 0), expression.transpose(1, 2, 0)
    joint_basis = np.zeros((j, 3, b), np.float32)
    joint_basis[:, :, :i] = joint_identity.transpose(1, 2, 0)
    if "triangles" in arrays:
        faces = take("triangles", None, 3, dtype=np.int64, below=v)
    else:  # the same two triangles of a quad, in the same order
        quads = take("quads", None, 4, dtype=np.int64, below=v)
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [2, 3, 0]]])
        faces = faces[(faces != faces[:, [1, 2, 0]]).all(axis=1)]  # a quad that names a corner twice is one triangle
    correctives = np.zeros((0, 3 * v), np.float32)
    if "pose_correctives_regressor" in arrays:
        correctives = take("pose_correctives_regressor", 9 * j, 3 * v)
    return {
        "v_template": template,
        "f": faces,
        "shapedirs": shapedirs,
        "posedirs": correctives.reshape(-1, v, 3).transpose(1, 2, 0),
        "J_regressor": take("joint_regressor", j, v),
        "weights": take("skinning_weights", j, v).T,
        "kintree_table": np.stack([take("joint_parent_indices", j, dtype=np.int64), np.arange(j)]),
        "num_identity": np.array(i),
        "joint_names": take("joint_names", j, dtype=np.str_),
        "joint_template": joints,
        "joint_basis": joint_basis,
        "expression_names": take("expression_names", b - i, dtype=np.str_),
        **{f"mask_{name}": ids for name, ids in _regions(arrays, template, faces, file).items()},
    }


def _regions(
    arrays: Mapping[str, Any], template: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], file: Path
) -> dict[str, Int[np.ndarray, " _"]]:
    """Regions by FLAME_masks' names: of the groups that the file has, the others by geometry (GNM has no scalp)."""
    if "vertex_groups" not in arrays:
        return {}
    weights = checked_array(arrays, "vertex_groups", (None, len(template)), np.float32, file=file)
    names = checked_array(arrays, "vertex_group_names", (len(weights),), np.str_, file=file)
    inside = dict(zip(map(str, names), weights >= MIN_WEIGHT, strict=True))
    masks = {
        region: np.any([inside[group] for group in groups], axis=0)
        for region, groups in GROUPS.items()
        if all(group in inside for group in groups)
    }
    for part, group in SIDED.items():
        for side in ("left", "right"):
            if group in inside and side in inside:
                masks[f"{side}_{part}"] = inside[group] & inside[side]
    regions = {name: np.flatnonzero(mask) for name, mask in masks.items()}
    if "skin_exterior" not in inside:
        return regions
    skin = inside["skin_exterior"]
    regions |= {name: np.flatnonzero(masks[name] & skin) for name in SKIN if name in masks}
    if any(len(regions.get(name, ())) == 0 for name in ("left_eyeball", "right_eyeball", "lips")):
        return regions
    vertices, lips = template.astype(np.float64), template[regions["lips"]].astype(np.float64)
    left, right = lips[lips[:, 0].argmax()], lips[lips[:, 0].argmin()]
    points = FacialPoints(regions["left_eyeball"], regions["right_eyeball"], left, right, lips.mean(axis=0))
    return geometric_regions(vertices, faces, points, skin) | regions
