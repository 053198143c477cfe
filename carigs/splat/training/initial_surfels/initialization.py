"""Initial surfels: an avatar's, or discs on triangles and inside hair and mouth, coloured from the training images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError, SettingsError
from carigs.head.facial_regions import eye_and_brow_faces
from carigs.mesh.carried_points import CarriedPoints
from carigs.raster import rasterize_mesh
from carigs.settings import Train
from carigs.splat.avatar import load_avatar
from carigs.splat.colour.spherical_harmonics import num_coefficients
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.rig import Rig
from carigs.splat.surfels.surfels import Surfels, flat_discs, from_arrays, to_arrays
from carigs.splat.training.initial_surfels.hair_surfels import HIDDEN_OPACITY, HairSurfels
from carigs.splat.training.initial_surfels.unseen_skin import COVERING_SCALE, UnseenSkin
from carigs.splat.training.supervision import Example, Supervision

OCCLUSION_TOLERANCE = 0.003
"""Metres that a surfel's centre may lie behind the mesh and still count as visible."""
COLOUR_FRAMES = 32
"""Training frames from which the initial colours are sampled."""
SPACE_OPACITY = 0.2
"""Initial opacity of the surfels inside hair and mouth."""
SPACE_SCALE, SPACE_SCALE_LIMITS = 0.4, (0.0005, 0.003)
"""Standard deviation of surfels beside the mesh over the distance of their neighbours, and its limits in metres."""


def initial_surfels(
    settings: Train,
    supervision: Supervision,
    sequence: HeadSequence,
    hair: HairSurfels | None = None,
    mouth: CarriedPoints | None = None,
    unseen: UnseenSkin | None = None,
) -> Surfels:
    """Take the surfels of the avatar `settings.start`, or initialize surfels on every face and inside hair and mouth.

    Initial colours are means over `COLOUR_FRAMES` training images: GT* targets if they alone supervise
    the run (`gtstar_probability` 1), otherwise captured frames.

    Args:
        settings: Settings of the training.
        supervision: Training images.
        sequence: Posed meshes per timestep and level.
        hair: Where hair is; None if there is none.
        mouth: Points inside the mouth; None if it stays empty.
        unseen: Skin that no training frame shows; None if it is treated like the other.

    Returns:
        Surfels, sorted by triangle.

    Raises:
        InputError: If the avatar cannot be read, or its head has other triangles.
        SettingsError: If `settings.sh_degree` is less than the avatar's.
    """
    if settings.start is not None:
        return surfels_of_avatar(Path(settings.start), sequence, settings.sh_degree)
    beside = [points for points in (None if hair is None else hair.points, mouth) if points is not None]
    placed = place(settings, sequence.rig, beside)
    binding, position = placed.binding, placed.position
    targets_only = settings.gtstar_probability >= 1
    count = len(supervision.targets if targets_only else supervision.frames)
    indices = evenly_spread(range(count), COLOUR_FRAMES)
    views = [supervision.weighted_example(targets_only, i) for i in indices]
    rgb = observed_colours(binding, position, sequence, views, hair, unseen)
    features = eye_and_brow_faces(sequence.head, sequence.head.v_template)
    opacity = np.where(features[binding], settings.initial_feature_opacity, settings.initial_opacity)
    if hair is not None:
        opacity[hair.hidden[binding]] = HIDDEN_OPACITY
    if unseen is not None:
        covering = unseen.faces[binding]
        opacity[covering] = unseen.opacity[binding[covering]]
        placed.scale[covering] = COVERING_SCALE / np.sqrt(settings.surfels_per_face)
    opacity[len(opacity) - sum(len(points.face) for points in beside) :] = SPACE_OPACITY
    return flat_discs(*placed[:3], opacity, rgb, settings.sh_degree, placed.rotation)


def surfels_of_avatar(file: Path, sequence: HeadSequence, sh_degree: int) -> Surfels:
    """Surfels of a trained avatar on the triangles of a subject.

    Args:
        file: The avatar.
        sequence: The subject.
        sh_degree: Degree of the spherical harmonics; degrees that the avatar lacks are 0.

    Returns:
        Its surfels.

    Raises:
        InputError: If the file cannot be read, or its head has other triangles than the subject's.
        SettingsError: If the degree is less than the avatar's.
    """
    avatar = load_avatar(file)
    if not np.array_equal(avatar.sequence.rig.faces, sequence.rig.faces):
        raise InputError("the head of this avatar has other triangles than the subject's", file=file)
    missing = num_coefficients(sh_degree) - avatar.surfels.harmonics.shape[1]
    if missing < 0:
        raise SettingsError(f"train.sh_degree={sh_degree} is less than the {avatar.surfels.sh_degree} of {file}")
    arrays = to_arrays(avatar.surfels)
    harmonics = np.pad(arrays.pop("harmonics"), ((0, 0), (0, missing), (0, 0)))
    return from_arrays(harmonics=harmonics, **arrays)


class Placement(NamedTuple):
    """Where surfels start, in the frames of their triangles."""

    binding: Int[np.ndarray, " n"]
    """Triangles."""
    position: Float[np.ndarray, "n 3"]
    """Centres in units of k."""
    scale: Float[np.ndarray, "n 2"]
    """Standard deviations along both axes in units of k."""
    rotation: Float[np.ndarray, "n 4"]
    """Quaternions (w, x, y, z)."""


def place(settings: Train, rig: Rig, beside: Sequence[CarriedPoints] = ()) -> Placement:
    """Positions of the initial surfels: on every face, and at points beside the mesh, which come last.

    Each face gets `surfels_per_face` surfels, spread by the low-discrepancy sequence R2 (Roberts 2018).

    Args:
        settings: Settings of the training.
        rig: Rig of the canonical mesh.
        beside: Points inside hair and mouth.

    Returns:
        Where they are.
    """
    per_face, f = settings.surfels_per_face, len(rig.faces)
    g = 1.324717957244746  # plastic number: g^3 = g + 1
    spread = (0.5 + np.arange(1, per_face + 1)[:, None] * np.array([1 / g, 1 / g**2])) % 1
    if per_face == 1:
        spread = np.array([[1 / 3, 1 / 3]])
    binding = np.repeat(np.arange(f), per_face)
    position = _in_triangle(rig, binding, np.tile(spread, (f, 1)))
    scale = np.full((len(binding), 2), settings.initial_scale / np.sqrt(per_face))
    rotation = np.tile([1.0, 0.0, 0.0, 0.0], (len(binding), 1))
    parts = [Placement(binding, position, scale, rotation), *(_beside(rig, points) for points in beside)]
    return Placement(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _beside(rig: Rig, points: CarriedPoints) -> Placement:
    """Discs at points beside the mesh, in the frames of the triangles that carry them."""
    offset = points.position - rig.vertices[rig.faces[points.face]].mean(axis=1)
    k = np.maximum(rig.scale[points.face], 1e-9)[:, None]
    to_local = rig.frame[points.face].swapaxes(1, 2)  # frame = k R
    local = np.einsum("nij,nj->ni", to_local, offset) / k**2
    axes = np.einsum("nij,njk->nik", to_local, points.axes) / k[:, None]
    axes = np.concatenate([axes, np.cross(axes[..., 0], axes[..., 1])[..., None]], axis=2)
    size = np.clip(SPACE_SCALE * points.spacing, *SPACE_SCALE_LIMITS)[:, None] / k
    size = size * np.sqrt(points.elongation)[:, None] ** [1, -1]
    return Placement(points.face, local, size, Rotation.from_matrix(axes).as_quat(scalar_first=True))


def start_distances(rig: Rig, beside: Sequence[CarriedPoints]) -> Float[np.ndarray, " f"]:
    """How far the surfels of each triangle start from it.

    Args:
        rig: The canonical mesh.
        beside: Points inside hair and mouth.

    Returns:
        Largest distances from the centres of the triangles, in units of k.
    """
    distances = np.zeros(len(rig.faces))
    for points in beside:
        centres = rig.vertices[rig.faces[points.face]].mean(axis=1)
        np.maximum.at(distances, points.face, np.linalg.norm(points.position - centres, axis=1))
    return distances / np.maximum(rig.scale, 1e-9)


def _in_triangle(
    rig: Rig, binding: Int[np.ndarray, " n"], uniform: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 3"]:
    """Points of the triangles in their local frames, from points of the unit square folded along its diagonal."""
    b, c = uniform.T
    fold = b + c > 1
    b, c = np.where(fold, 1 - b, b), np.where(fold, 1 - c, c)
    corners = rig.vertices[rig.faces[binding]]
    offset = np.einsum("nk,nkc->nc", np.stack([1 - b - c, b, c], axis=1), corners) - corners.mean(axis=1)
    scale_squared = np.maximum(rig.scale[binding, None], 1e-9) ** 2
    return np.einsum("nji,nj->ni", rig.frame[binding], offset) / scale_squared  # frame = k R


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
    surfels on hidden triangles, whose pixels show what covers them. On unseen skin, colours continue smoothly.

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
