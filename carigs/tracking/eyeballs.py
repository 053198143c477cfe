"""Eyeballs as bodies of their own: they keep their form, lie in their sockets, and lids slide in front of them.

One camera hardly tells how deep skin lies. Landmarks of irises and lids, followed as they are, bent the eyeballs of a
person's footage and put them 2 to 4 millimetres in front of the lids: eyes that were closed showed the iris.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from carigs.head import HeadModel, HeadParameters
from carigs.head.facial_regions import lid_faces
from carigs.head.posing import pose_frames
from carigs.tracking.cameras import Cameras
from carigs.tracking.own_blendshapes import principal_shapes, skinning_turns, with_own_blendshapes

MARGIN = 0.0003
"""Metres by which lids lie at least in front of the eyeball."""
BEHIND = 0.0003
"""Metres by which a vertex of the head model may lie inside of its eyeball to count as the outside of a lid."""
SIDE = 0.85
"""Distance from the line of sight to the eyeball's centre, in radii, up to which lids are held in front."""
NEIGHBOURS = 3
"""Vertices of an eyeball from which its radius in a direction is interpolated."""
ROUNDS, DECAY = 6, 0.9
"""Times that a displacement spreads to neighbouring vertices, and what is left of it each time."""
MODES = 12
"""Most blendshapes."""
NEGLIGIBLE = 1e-5
"""Metres of the root mean square displacement, below which there is no blendshape."""


class Eye(NamedTuple):
    """An eyeball of a head model, and the lids around it."""

    ball: Int[np.ndarray, " b"]
    """Vertices of the eyeball."""
    lids: Int[np.ndarray, " n"]
    """Vertices of the lids, with those inside of the socket."""


def eyes(model: HeadModel) -> list[Eye]:
    """Find the eyes of a head model.

    Args:
        model: The head model.

    Returns:
        The eyes whose eyeball and lids the model names.
    """
    ball = model.vertex_region("left_eyeball", "right_eyeball")
    lids = np.unique(model.faces[lid_faces(model, model.v_template)])
    lids = lids[~ball[lids]]
    regions = [np.flatnonzero(model.vertex_region(f"{side}_eyeball")) for side in ("left", "right")]
    regions = [region for region in regions if len(region)]
    if not regions or not len(lids):
        return []
    centres = np.stack([model.v_template[region].mean(axis=0) for region in regions])
    nearest = np.linalg.norm(model.v_template[lids, None] - centres, axis=2).argmin(axis=1)
    return [Eye(region, lids[nearest == i]) for i, region in enumerate(regions) if (nearest == i).any()]


def with_rigid_eyeballs(model: HeadModel, offset: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    """Move each eyeball as a whole, as its lids are displaced on the average.

    Args:
        model: The head model.
        offset: Displacements of the neutral head in metres.

    Returns:
        The displacements, those of eyeballs replaced.
    """
    moved = offset.copy()
    for eye in eyes(model):
        moved[eye.ball] = offset[eye.lids].mean(axis=0)
    return moved


def lids_before_eyeballs(
    model: HeadModel, parameters: Sequence[HeadParameters], cameras: Cameras
) -> tuple[HeadModel, list[HeadParameters]]:
    """Add blendshapes that hold the lids in front of the eyeballs, where the frames have them inside.

    A vertex of a lid moves towards the cameras, along the direction in which they see the eye on the average: a single
    camera shows it where it showed it before.

    Args:
        model: The head model.
        parameters: Those of each timestep.
        cameras: The cameras.

    Returns:
        The model with more expressions, principal components of the displacements, and parameters with their
        coefficients. Both are as they were if no lid lies inside of an eyeball.
    """
    found = eyes(model)
    if not found:
        return model, list(parameters)
    posed = pose_frames(model, parameters)
    moved = np.concatenate([_displacements(model, eye, posed, cameras) for eye in found], axis=1)
    vertices = np.concatenate([eye.lids for eye in found])
    turned = skinning_turns(model, parameters, model.weights[vertices])
    components, coefficients = principal_shapes(np.einsum("tnxy,tnx->tny", turned, moved), MODES)
    used = np.linalg.norm(components, axis=(0, 1)) > NEGLIGIBLE
    if not used.any():
        return model, list(parameters)
    shapes = np.zeros((*model.v_template.shape, used.sum()))
    shapes[vertices] = components[..., used]
    return with_own_blendshapes(model, parameters, shapes, coefficients[:, used])


def _displacements(
    model: HeadModel, eye: Eye, posed: Float[np.ndarray, "t v 3"], cameras: Cameras
) -> Float[np.ndarray, "t n 3"]:
    """Displacements of the lids of an eye towards the cameras, in world axes."""
    outside, spread = _outside(model, eye), _spreading(model, eye)
    world = cameras.camera_from_world()
    centres = -np.einsum("cji,cj->ci", world[..., :3], world[..., 3])
    moved = np.zeros((len(posed), len(eye.lids), 3))
    for t, vertices in enumerate(posed):
        ball = vertices[eye.ball]
        middle = _centre(ball)
        towards = centres - middle
        towards = (towards / np.linalg.norm(towards, axis=1, keepdims=True)).sum(axis=0)
        towards /= np.linalg.norm(towards)
        amount = _inside(vertices[eye.lids] - middle, ball - middle, towards) * outside
        for _ in range(ROUNDS if amount.any() else 0):
            amount = np.maximum(amount, DECAY * (spread @ amount))
        moved[t] = amount[:, None] * towards
    return moved


def _centre(ball: Float[np.ndarray, "b 3"]) -> Float[np.ndarray, "3"]:
    """Centre of the sphere nearest to an eyeball by least squares: 2 c x + (r^2 - c^2) = x^2 is linear in both."""
    mean = ball.mean(axis=0)  # numbers of the size of the eyeball
    rows = np.hstack([2 * (ball - mean), np.ones((len(ball), 1))])
    return mean + np.linalg.lstsq(rows, ((ball - mean) ** 2).sum(axis=1), rcond=None)[0][:3]


def _inside(
    lids: Float[np.ndarray, "n 3"], ball: Float[np.ndarray, "b 3"], towards: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " n"]:
    """How far vertices must go along a direction to lie in front of an eyeball; all relative to its centre."""
    radii = np.linalg.norm(ball, axis=1)
    distance = np.linalg.norm(lids, axis=1)
    away, which = cKDTree(ball / radii[:, None]).query(lids / np.maximum(distance, 1e-9)[:, None], NEIGHBOURS)
    weight = 1 / (away + 1e-6)
    radius = (weight * radii[which]).sum(axis=1) / weight.sum(axis=1) + MARGIN
    along = lids @ towards
    beside = distance**2 - along**2
    needed = np.sqrt(np.maximum(radius**2 - beside, 0)) - along
    return np.where((along > 0) & (beside < (SIDE * radius) ** 2), np.maximum(needed, 0), 0)


def _outside(model: HeadModel, eye: Eye) -> Bool[np.ndarray, " n"]:
    """Vertices of the lids that lie in front of the head model's own eyeball; others lie in the socket."""
    middle = _centre(model.v_template[eye.ball])
    lids, ball = model.v_template[eye.lids] - middle, model.v_template[eye.ball] - middle
    return _inside(lids, ball, np.array([0.0, 0.0, 1.0])) < MARGIN + BEHIND


def _spreading(model: HeadModel, eye: Eye) -> csr_array:
    """Averages over neighbours among the lids."""
    adjacent = csr_array(igl.adjacency_matrix(model.faces.astype(np.int64)))[eye.lids][:, eye.lids]
    counts = np.maximum(adjacent.sum(axis=1), 1)
    return csr_array(adjacent.multiply(1 / counts[:, None]))
