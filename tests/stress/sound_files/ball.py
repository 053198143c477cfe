"""A ball with the arrays of a head model, as FLAME and as GNM have them."""

from __future__ import annotations

import numpy as np
import trimesh

from carigs.capture import Camera, look_at
from carigs.head import HeadModel

CAMERA = Camera(look_at(np.array([0.0, 0.0, 0.6]), np.zeros(3)), 60.0, 60.0, 16.0, 12.0, 32, 24)
BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
VERTICES, FACES = np.asarray(BALL.vertices, np.float32), np.asarray(BALL.faces, np.int32)


def head_model() -> HeadModel:
    """A ball as head model.

    Returns:
        The model.
    """
    random, v = np.random.default_rng(0), len(VERTICES)
    expressions = random.normal(0, 0.003, (v, 3, 100))
    return HeadModel(
        v_template=VERTICES,
        faces=FACES,
        shapedirs=np.concatenate([np.zeros((v, 3, 300)), expressions], axis=2).astype(np.float32),
        posedirs=random.normal(0, 0.003, (v, 3, 36)).astype(np.float32),
        joint_regressor=np.full((5, v), 1 / v, np.float32),
        weights=np.tile(np.float32([1, 0, 0, 0, 0]), (v, 1)),
        parents=np.array([-1, 0, 1, 1, 1]),
        regions={"nose": np.array([1, 2])},
    )


def gnm_arrays() -> dict[str, np.ndarray]:
    """The ball in the layout of GNM Head, with eyes and lips.

    Returns:
        Arrays by GNM's names.
    """
    random, v, j = np.random.default_rng(2), len(VERTICES), 4
    groups = {"skin_exterior": VERTICES[:, 2] < 0.09, "upper_lip": VERTICES[:, 1] < -0.09}
    groups |= {"lower_lip": groups["upper_lip"], "left_eye": VERTICES[:, 0] > 0.08, "right_eye": VERTICES[:, 0] < -0.08}
    return {
        "template_vertex_positions": VERTICES, "template_joint_positions": np.zeros((j, 3), np.float32),
        "vertex_identity_basis": random.normal(0, 0.003, (2, v, 3)).astype(np.float32),
        "joint_identity_basis": random.normal(0, 0.003, (2, j, 3)).astype(np.float32),
        "expression_basis": random.normal(0, 0.003, (3, v, 3)).astype(np.float32),
        "joint_names": np.array(["neck", "head", "left_eye", "right_eye"]),
        "expression_names": np.array(["a", "b", "c"]), "joint_parent_indices": np.array([0, 0, 1, 1]),
        "skinning_weights": np.eye(j, dtype=np.float32)[:, np.zeros(v, int)], "triangles": FACES,
        "joint_regressor": np.full((j, v), 1 / v, np.float32),
        "pose_correctives_regressor": random.normal(0, 0.003, (9 * j, 3 * v)).astype(np.float32),
        "vertex_group_names": np.array(list(groups)), "vertex_groups": np.array(list(groups.values()), np.float32),
    }  # fmt: skip
