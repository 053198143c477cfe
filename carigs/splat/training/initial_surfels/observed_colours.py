"""Colours that surfels start with: those that the images show at their centres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.raster import rasterize_mesh
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.training.initial_surfels.hair_surfels import HairSurfels
from carigs.splat.training.initial_surfels.unseen_skin import UnseenSkin
from carigs.splat.training.supervision import Example

OCCLUSION_TOLERANCE = 0.003
"""Metres that a surfel's centre may lie behind the mesh and still count as visible."""


def observed_colours(
    binding: Int[np.ndarray, " n"],
    position: Float[np.ndarray, "n 3"],
    sequence: HeadSequence,
    views: list[tuple[Example, Float[np.ndarray, "h w"]]],
    hair: HairSurfels | None = None,
    unseen: UnseenSkin | None = None,
) -> Float[np.ndarray, "n 3"]:
    """Mean colour of each surfel over the views that see its centre, weighted by the cosine of the viewing angle.

    Surfels that no view sees take the mean colour of their face, or else of the nearest faces with a colour. So do
    surfels on hidden triangles, whose pixels show what covers them. On unseen skin, colours continue smoothly, and
    on the unseen scalp those that are nearer to the hair than to the skin.

    Args:
        binding: Triangle of each surfel.
        position: Centres in the triangles' frames, in units of k.
        sequence: Posed meshes per timestep and level.
        views: Images with the weights of their pixels.
        hair: Where hair is.
        unseen: Skin that no training frame shows.

    Returns:
        RGB in [0.02, 0.98].
    """
    rig = sequence.rig
    canonical = np.einsum("nij,nj->ni", rig.frame[binding], position)
    total, weight = np.zeros((len(binding), 3)), np.zeros(len(binding))
    for example, pixel_weight in views:
        camera = example.camera
        motion = sequence.motion(example.timestep, example.level)
        centre = motion.centre[binding] + np.einsum("nij,nj->ni", motion.jacobian[binding], canonical)
        pixel, depth = camera.project(centre)
        surface = rasterize_mesh(sequence.posed(example.timestep, example.level), rig.faces, camera).depth
        inside = (depth > 0) & (pixel >= 0).all(axis=1) & (pixel < [camera.width, camera.height]).all(axis=1)
        column, row = np.where(inside[:, None], pixel, 0).astype(int).T
        seen = inside & (depth < surface[row, column] + OCCLUSION_TOLERANCE)
        normal = motion.rotation[binding] @ (rig.frame[binding, :, 2] / rig.scale[binding, None].clip(1e-9))[..., None]
        view = camera.centre - centre
        facing = np.einsum("nc,nc->n", normal[..., 0], view) / np.linalg.norm(view, axis=1)
        w = np.where(seen, facing.clip(0.05), 0) * pixel_weight[row, column]
        total += w[:, None] * example.image[row, column]
        weight += w
    face_total = np.stack([np.bincount(binding, total[:, c], len(rig.faces)) for c in range(3)], axis=1)
    face_weight = np.bincount(binding, weight, len(rig.faces))
    face = _fill(face_total, face_weight, rig.neighbours)
    if hair is not None:
        skin_weight = np.where(hair.skin, face_weight, 0)
        face[hair.hidden] = _fill(face_total, skin_weight, rig.neighbours)[hair.hidden]
        weight = np.where(hair.hidden[binding], 0, weight)
    if unseen is not None:
        known = face_weight > 0 if hair is None else (face_weight > 0) & ~hair.hidden
        above = (unseen.well_seen & unseen.scalp)[binding] & (position[:, 2] > 0) & (weight > 0)
        skin = known & unseen.well_seen & ~unseen.scalp
        if hair is not None and above.any() and skin.any():
            # The scalp of a head model has a hairline of its own: skin below it does not continue as hair.
            of_hair, of_skin = np.median(total[above] / weight[above, None], axis=0), np.median(face[skin], axis=0)
            known &= ~unseen.scalp | _is_nearer(face, of_hair, of_skin)
        face[unseen.faces] = unseen.continued(face, known)[unseen.faces]
        weight = np.where(unseen.faces[binding], 0, weight)
    return np.where(weight[:, None] > 0, total / np.maximum(weight, 1e-12)[:, None], face[binding]).clip(0.02, 0.98)


def _fill(
    total: Float[np.ndarray, "f 3"], weight: Float[np.ndarray, " f"], neighbours: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "f 3"]:
    """Mean colour per face; faces without one take their neighbours' mean, ring by ring, then the overall mean."""
    colour = total / np.maximum(weight, 1e-12)[:, None]
    known = weight > 0
    while True:
        around = known[neighbours] & ~known[:, None]
        new = around.any(axis=1)
        if not new.any():
            break
        share = around[new] / around[new].sum(axis=1, keepdims=True)
        colour[new] = np.einsum("fk,fkc->fc", share, colour[neighbours[new]])
        known |= new
    if known.any():
        colour[~known] = colour[known].mean(axis=0)
    else:
        colour[:] = 0.5
    return colour


def _is_nearer(
    colour: Float[np.ndarray, "f 3"], one: Float[np.ndarray, " 3"], other: Float[np.ndarray, " 3"]
) -> Bool[np.ndarray, " f"]:
    """Whether colours are nearer to one colour than to another."""
    return np.linalg.norm(colour - one, axis=1) < np.linalg.norm(colour - other, axis=1)
