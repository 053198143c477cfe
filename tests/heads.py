"""Small head models with every array filled, and GNM's file in its layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carigs.head import HeadModel
from carigs.head.model_arrays import FLAME_JOINTS


def parents_of(joints: int) -> np.ndarray:
    """FLAME's tree, grown: root, neck, and all others on the neck."""
    return np.array([-1, 0, *[1] * joints])[:joints]


def random_model(
    seed: int = 0, v: int = 30, joints: int = 5, identities: int = 300, expressions: int = 100, corrected: int = 4
) -> HeadModel:
    """A head with every array filled; vertices 0, 6, 12... have the weight of one joint each."""
    random = np.random.default_rng(seed)
    corrected = min(corrected, joints)
    weights = random.dirichlet(np.ones(joints), v)
    weights[::6] = np.eye(joints)[np.arange(len(weights[::6])) % joints]
    return HeadModel(
        v_template=random.normal(size=(v, 3)).astype(np.float32),
        faces=random.permutation(v)[: v - v % 3].reshape(-1, 3).astype(np.int32),
        shapedirs=(0.1 * random.normal(size=(v, 3, identities + expressions))).astype(np.float32),
        posedirs=(0.1 * random.normal(size=(v, 3, 9 * corrected))).astype(np.float32),
        joint_regressor=random.dirichlet(np.ones(v), joints).astype(np.float32),
        weights=weights.astype(np.float32),
        parents=parents_of(joints),
        num_identity=identities,
        joint_names=FLAME_JOINTS if joints == 5 else tuple("abcdefghij"[:joints]),
        regions={"nose": np.array([1, 2, 3]), "lips": np.array([4])},
        expression_names=("jawOpen",),
    )


def gnm_like(seed: int, v: int = 24) -> dict[str, np.ndarray]:
    """Arrays in the layout of gnm_head.npz: 6 identities, 5 expressions, 4 joints."""
    random = np.random.default_rng(seed)
    quads = random.permutation(v)[: v - v % 4].reshape(-1, 4).astype(np.int32)
    names = ["ears", "left", "right", "upper_lip", "lower_lip", "left_eye", "right_eye", "skin_exterior"]
    groups = np.zeros((len(names), v), np.float32)
    for name, ids in {"ears": [0, 1], "left": [0, 4], "right": [1, 5], "left_eye": [4], "right_eye": [5]}.items():
        groups[names.index(name), ids] = 1
    groups[names.index("upper_lip"), [2, 6]] = 1.0, 0.2
    groups[names.index("lower_lip"), 3] = 0.5
    groups[names.index("skin_exterior"), [0, 1, 2, 3, 6]] = 1
    return {
        "version": np.array("3.0"),
        "variant": np.array("head"),
        "template_vertex_positions": random.normal(size=(v, 3)).astype(np.float32),
        "template_joint_positions": random.normal(size=(4, 3)).astype(np.float32),
        "vertex_identity_basis": 0.1 * random.normal(size=(6, v, 3)).astype(np.float32),
        "joint_identity_basis": 0.1 * random.normal(size=(6, 4, 3)).astype(np.float32),
        "expression_basis": 0.1 * random.normal(size=(5, v, 3)).astype(np.float32),
        "identity_names": np.array([f"head_{i}" for i in range(6)]),
        "expression_names": np.array([f"lower_face_region_{i}" for i in range(5)]),
        "joint_names": np.array(["neck", "head", "left_eye", "right_eye"]),
        "joint_parent_indices": np.array([0, 0, 1, 1]),
        "skinning_weights": random.dirichlet(np.ones(4), v).T.astype(np.float32),
        "quads": quads,
        "triangles": np.concatenate([quads[:, [0, 1, 2]], quads[:, [2, 3, 0]]]),
        "quad_uvs": random.random((len(quads), 4, 2)).astype(np.float32),
        "triangle_uvs": random.random((2 * len(quads), 3, 2)).astype(np.float32),
        "mesh_component_names": np.array(["skin"]),
        "mirror_indices": np.arange(v),
        "joint_regressor": random.dirichlet(np.ones(v), 4).astype(np.float32),
        "pose_correctives_regressor": 0.1 * random.normal(size=(36, 3 * v)).astype(np.float32),
        "vertex_groups": groups,
        "vertex_group_names": np.array(names),
    }


def gnm_file(folder: Path, arrays: dict[str, np.ndarray]) -> Path:
    """Write the arrays as gnm_head.npz."""
    np.savez(folder / "gnm_head.npz", **arrays)
    return folder / "gnm_head.npz"
