"""Initial surfels: an avatar's, or discs on triangles and beside the mesh, coloured from the training images."""

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
from carigs.settings import Train
from carigs.splat.avatar import load_avatar
from carigs.splat.colour.spherical_harmonics import num_coefficients
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.rig import Rig
from carigs.splat.surfels.surfels import Surfels, flat_discs, from_arrays, to_arrays
from carigs.splat.training.initial_surfels.body_cover import BodyCover
from carigs.splat.training.initial_surfels.hair_surfels import HIDDEN_OPACITY, HairSurfels
from carigs.splat.training.initial_surfels.observed_colours import observed_colours
from carigs.splat.training.initial_surfels.unseen_skin import KEPT_SCALE, LIFTED_SCALE, UnseenSkin
from carigs.splat.training.supervision import Supervision

COLOUR_FRAMES = 32
"""Training frames from which the initial colours are sampled."""
FEATURE_OPACITY = 0.3
"""Largest initial opacity of surfels on eyeballs, lids and brows."""
SPACE_SCALE, SPACE_SCALE_LIMITS = 0.4, (0.0005, 0.003)
"""Standard deviation of surfels beside the mesh over the distance of their neighbours, and its limits in metres."""


def initial_surfels(
    settings: Train,
    supervision: Supervision,
    sequence: HeadSequence,
    hair: HairSurfels | None = None,
    beside: Sequence[CarriedPoints] = (),
    unseen: UnseenSkin | None = None,
    body_cover: BodyCover | None = None,
) -> Surfels:
    """Take the surfels of the avatar `settings.start`, or initialize surfels on every face, and beside the mesh.

    Initial colours are means over `COLOUR_FRAMES` training images: GT* targets if they alone supervise
    the run (`gtstar_probability` 1), otherwise captured frames.

    Args:
        settings: Settings of the training.
        supervision: Training images.
        sequence: Posed meshes per timestep and level.
        hair: Where hair is; None if there is none.
        beside: Points inside the mouth and of the body.
        unseen: Skin that no training frame shows; None if it is treated like the other.
        body_cover: Discs that cover the body where no frame shows it; None if there are none. Its seen points, then its
            discs, are the last two of `beside`.

    Returns:
        Surfels, sorted by triangle.

    Raises:
        InputError: If the avatar cannot be read, or its head has other triangles.
        SettingsError: If `settings.sh_degree` is less than the avatar's.
    """
    if settings.start is not None:
        return surfels_of_avatar(Path(settings.start), sequence, settings.sh_degree)
    points = [*beside] if hair is None else [*hair.all_points, *beside]
    placed = place(settings, sequence.rig, points)
    binding, position = placed.binding, placed.position
    targets_only = settings.gtstar_probability >= 1
    count = len(supervision.targets if targets_only else supervision.frames)
    indices = evenly_spread(range(count), COLOUR_FRAMES)
    views = [supervision.weighted_example(targets_only, i) for i in indices]
    rgb = observed_colours(binding, position, sequence, views, hair, unseen)
    on_mesh = len(binding) - sum(len(each.face) for each in points)
    grafts = None if hair is None else hair.grafts
    if grafts is not None:
        first = on_mesh + len(hair.points.face)
        mine = slice(first, first + len(grafts.source))
        rgb[mine] = grafts.colours(rgb[mine], rgb[on_mesh:first], hair.points.face)
    if body_cover is not None:
        first = len(binding) - len(body_cover.points.face)
        rgb[first:] = body_cover.colours(rgb[first - len(body_cover.body.face) : first])
    features = eye_and_brow_faces(sequence.head, sequence.head.v_template)
    opacity = np.full(len(binding), settings.initial_opacity)
    opacity[features[binding]] = min(settings.initial_opacity, FEATURE_OPACITY)
    if hair is not None:
        opacity[hair.hidden[binding]] = HIDDEN_OPACITY
    if unseen is not None:
        covering = unseen.faces[binding]
        opacity[covering] = unseen.opacity[binding[covering]]
        kept = np.flatnonzero(unseen.kept[binding[:on_mesh]])
        scale = np.where(unseen.scalp, LIFTED_SCALE, KEPT_SCALE) / np.sqrt(settings.surfels_per_face)
        placed.scale[kept] = scale[binding[kept], None]
        if grafts is not None:
            height = grafts.height / np.maximum(sequence.rig.scale, 1e-9)
            position[kept, 2] += height[binding[kept]]
    inside = [np.full(len(each.face), each.opacity) for each in points]
    opacity[on_mesh:] = np.concatenate([np.zeros(0), *inside])
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
        beside: Points inside hair, mouth and body.

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
        beside: Points inside hair, mouth and body.

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
