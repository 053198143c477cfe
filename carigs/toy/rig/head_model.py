"""The head model of the procedural person, in FLAME's format (metres)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from carigs.head import HeadModel
from carigs.head.model import N_SHAPE
from carigs.toy.rig import expressions, identity
from carigs.toy.rig.landmarks import landmarks68
from carigs.toy.rig.regions import regions
from carigs.toy.rig.skin_weights import PARENTS, joint_regressor, skin_weights
from carigs.toy.shape.template import template

MILLIMETRE = 1e-3
N_COLUMNS = 400  # FLAME's: 300 identity, 100 expression


@lru_cache(maxsize=1)
def head_model() -> HeadModel:
    """Template, bases, joints, skin weights, regions and landmarks; the same for every person."""
    shape = template()
    eyeball = shape.left_eye.astype(float) - shape.right_eye
    shapedirs = np.zeros((len(shape.vertices), 3, N_COLUMNS), np.float32)
    people = identity.identity_basis(shape.vertices, eyeball)
    faces = expressions.expression_basis(shape.vertices, shape.skin.astype(float))
    shapedirs[:, :, : people.shape[2]] = people * MILLIMETRE
    shapedirs[:, :, N_SHAPE : N_SHAPE + faces.shape[2]] = faces * MILLIMETRE
    return HeadModel(
        v_template=(shape.vertices * MILLIMETRE).astype(np.float32),
        faces=shape.faces,
        shapedirs=shapedirs,
        posedirs=np.zeros((len(shape.vertices), 3, 36), np.float32),
        joint_regressor=joint_regressor(shape).astype(np.float32),
        weights=skin_weights(shape).astype(np.float32),
        parents=PARENTS,
        regions=regions(shape),
        expression_names=expressions.NAMES,
        landmarks68=landmarks68(shape),
    )
