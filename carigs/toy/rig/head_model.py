"""The head model of the procedural subject, in FLAME's format (metres)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from carigs.head import HeadModel, SurfacePoints
from carigs.head.model_arrays import FLAME_NUM_IDENTITY
from carigs.toy.rig import expressions, identity
from carigs.toy.rig.landmarks import landmarks68
from carigs.toy.rig.regions import vertex_regions
from carigs.toy.rig.skin_weights import PARENTS, joint_regressor, skin_weights
from carigs.toy.shape.template import build_template

METRES_PER_MILLIMETRE = 1e-3
_N_COLUMNS = 400  # as in FLAME: 300 identity, 100 expression


@lru_cache(maxsize=1)
def head_model() -> HeadModel:
    """Build the head model, which is the same for every person (cached).

    Returns:
        Template, blendshapes, joints, skinning weights, regions and landmarks; lengths in metres.
    """
    template = build_template()
    n = len(template.vertices)
    eyeball = template.left_eye.astype(float) - template.right_eye
    shapedirs = np.zeros((n, 3, _N_COLUMNS), np.float32)
    identities = identity.identity_basis(template.vertices, eyeball)
    actions = expressions.expression_basis(template.vertices, template.on_head.astype(float))
    shapedirs[:, :, : identities.shape[2]] = identities * METRES_PER_MILLIMETRE
    shapedirs[:, :, FLAME_NUM_IDENTITY : FLAME_NUM_IDENTITY + actions.shape[2]] = actions * METRES_PER_MILLIMETRE
    return HeadModel(
        v_template=(template.vertices * METRES_PER_MILLIMETRE).astype(np.float32),
        faces=template.faces,
        shapedirs=shapedirs,
        posedirs=np.zeros((n, 3, 36), np.float32),
        joint_regressor=joint_regressor(template).astype(np.float32),
        weights=skin_weights(template).astype(np.float32),
        parents=PARENTS,
        regions=vertex_regions(template),
        expression_names=expressions.NAMES,
        landmarks68=SurfacePoints.at_vertices(landmarks68(template)),
    )
