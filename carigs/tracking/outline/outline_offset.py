"""A smooth displacement of the head that brings its outline onto the mattes.

Landmarks of a network lie on the face alone, and say little about depth. Ears, the profile of nose and forehead, and
the width of the cheeks stay those of the head model, of somebody else: on footage of a person, ears were up to 8 mm off
and the profile up to 4 mm. Where the head turns, the edge of the matte shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from scipy.spatial.transform import Rotation

from carigs.capture import Camera
from carigs.fitting.outline_term import outline_lines
from carigs.head import HeadModel, HeadParameters, SurfacePoints, neutral, pose
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import compute_visibility
from carigs.raster.vertex_colours import visible_vertices
from carigs.tracking.outline.skin_colours import SkinColours
from carigs.tracking.outline.spatial_field import SpatialField

SKIN = ("face", "nose", "forehead", "left_ear", "right_ear")
"""Regions whose outline is compared: hair stands off the scalp, and mattes end at the neck."""
OTHER = ("scalp", "left_eyeball", "right_eyeball", "boundary")
"""Regions that are left out of those, with which they overlap."""
REACHES = (0.05, 0.05, 0.04, 0.03, 0.03)
"""Of each round: how far the edge of the matte is searched, in sizes of the silhouette."""
DEPTHS = (2.0, 3.0, 4.0)
"""Pixels inside the edge of the matte where the colour is looked at."""
OUTLIER_INSIDE, OUTLIER_OUTSIDE = 0.003, 0.002
"""Metres at which a distance counts a quarter of what it would (Geman and McClure), where the matte ends inside and
outside of the mesh: hair and clothes stand off."""
SIGMA = 0.001
"""Standard deviation of the outline in metres, that of all views together: their errors are correlated."""
ACROSS, EYES, JOINTS = 0.001, 0.0005, 1e-5
"""Standard deviations in metres: of landmarks as they are seen from the front, where the tracker has put them; of
eyeballs, on which lids lie; and of joints, because rotations were found with joints where they are."""
LEAST_FACE = 20
"""Landmarks that a view must show to tell what colour the skin has."""


@dataclass(frozen=True)
class OutlineView:
    """A frame of tracked footage."""

    camera: Camera
    parameters: HeadParameters
    image: UInt8[np.ndarray, "h w 3"]
    alpha: Float32[np.ndarray, "h w"]


class _Posed(NamedTuple):
    """A head in a view."""

    vertices: Float[np.ndarray, "v 3"]
    turn: Float[np.ndarray, "3 3"]
    """World from rest: the head turns as one piece, but for the jaw."""

    def displaced(self, offset: Float[np.ndarray, "v 3"]) -> _Posed:
        return self._replace(vertices=self.vertices + offset @ self.turn.T)


class _Distances(NamedTuple):
    """How far, in metres, vertices on the outline have to go along directions at rest."""

    vertex: Int[np.ndarray, " k"]
    direction: Float[np.ndarray, "k 3"]
    distance: Float[np.ndarray, " k"]
    weight: Float[np.ndarray, " k"]


def outline_offset(
    model: HeadModel, views: Sequence[OutlineView], landmarks: SurfacePoints
) -> Float[np.ndarray, "v 3"]:
    """Displace the head so that its outline lies at the edge of the mattes.

    A vertex on the outline has to go as far along its normal as the edge of the matte is away in the image. The
    displacement is smooth (`SpatialField`), and keeps landmarks where they are seen from the front, eyeballs, and
    joints. It is found in rounds, because other vertices come to lie on the outline.

    Args:
        model: The head model.
        views: Frames from many directions.
        landmarks: Points of the face, whose colour is the skin's.

    Returns:
        What is added to the static offset, in metres; 0 if no view shows an edge of skin, or if the model does not
        name the regions `SKIN`: all of it may be under hair then.
    """
    rest = neutral(model, views[0].parameters)
    candidates = np.flatnonzero(model.vertex_region(*SKIN) & ~model.vertex_region(*OTHER))
    if not len(candidates):
        return np.zeros_like(rest)
    field, face = SpatialField(rest, candidates), np.unique(landmarks.corners)
    kept, kept_information = _kept(model, field, landmarks)
    posed = [_posed(model, view, rest, candidates) for view in views]
    offset = np.zeros_like(rest)
    for reach in REACHES:
        found = [
            _distances(view, head.displaced(offset), model.faces, candidates, face, reach)
            for view, head in zip(views, posed, strict=True)
        ]
        vertex, direction, distance, weight = map(np.concatenate, zip(*found, strict=True))
        if not len(vertex):
            break
        # Sums over the equations of each vertex.
        seen, which = np.unique(vertex, return_inverse=True)
        weight = weight / len(views) / SIGMA**2
        wanted = distance + np.einsum("ki,ki->k", direction, offset[vertex])
        information, weighted = np.zeros((len(seen), 3, 3)), np.zeros((len(seen), 3))
        np.add.at(information, which, weight[:, None, None] * direction[:, :, None] * direction[:, None])
        np.add.at(weighted, which, (weight * wanted)[:, None] * direction)
        offset = field.fit(
            np.concatenate([field.values[seen], kept]),
            np.concatenate([information, kept_information]),
            np.concatenate([weighted, np.zeros((len(kept), 3))]),
        )
    return offset


def _kept(
    model: HeadModel, field: SpatialField, landmarks: SurfacePoints
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n 3 3"]]:
    """Points that are not displaced: the field's basis functions there, and their information."""
    eyes = np.flatnonzero(model.vertex_region("left_eyeball", "right_eyeball"))
    points = (
        (landmarks.interpolate(field.values), np.diag([1.0, 1.0, 0.0]) / ACROSS**2),  # the face looks along z
        (field.values[eyes], np.eye(3) / EYES**2 / max(len(eyes), 1)),
        (model.joint_regressor.astype(np.float64) @ field.values, np.eye(3) / JOINTS**2),
    )
    return (
        np.concatenate([values for values, _ in points]),
        np.concatenate([np.broadcast_to(information, (len(values), 3, 3)) for values, information in points]),
    )


def _posed(
    model: HeadModel, view: OutlineView, rest: Float[np.ndarray, "v 3"], candidates: Int[np.ndarray, " n"]
) -> _Posed:
    vertices = pose(model, view.parameters)
    here, there = rest[candidates], vertices[candidates]
    turn, _ = Rotation.align_vectors(there - there.mean(axis=0), here - here.mean(axis=0))
    return _Posed(vertices, turn.as_matrix())


def _distances(
    view: OutlineView,
    posed: _Posed,
    faces: Int[np.ndarray, "f 3"],
    candidates: Int[np.ndarray, " n"],
    face: Int[np.ndarray, " m"],
    reach: float,
) -> _Distances:
    """Distances to the edge of the matte in one view, where skin ends there."""
    camera, normals = view.camera, vertex_normals(posed.vertices, faces)
    visibility = compute_visibility(posed.vertices, faces, camera)
    seen = visible_vertices(visibility, posed.vertices, normals)
    colours = _colours_at(view.image, seen.pixels[np.isin(seen.index, face)])
    lines = outline_lines(visibility, normals, view.alpha, candidates, reach=reach)
    vertex, across = candidates[lines.point], lines.normals
    pixels = visibility.pixels[vertex]
    crossing = lines.offsets - np.einsum("ki,ki->k", across, pixels)
    edge = pixels + crossing[:, None] * across
    inside = np.mean([_colours_at(view.image, edge - depth * across) for depth in DEPTHS], axis=0)
    skin = SkinColours(colours).contains(inside) if len(colours) >= LEAST_FACE else np.zeros(len(vertex), bool)
    distance = crossing * visibility.camera_points[vertex, 2] / camera.intrinsics[0]
    scale = np.where(distance > 0, OUTLIER_OUTSIDE, OUTLIER_INSIDE)
    direction = across @ camera.camera_from_world[:2, :3] @ posed.turn
    rows = vertex, direction, distance, (1 + (distance / scale) ** 2) ** -2.0
    return _Distances(*(values[skin] for values in rows))


def _colours_at(image: UInt8[np.ndarray, "h w 3"], pixels: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 3"]:
    """Bilinear interpolation, in [0, 1]."""
    if not len(pixels):
        return np.zeros((0, 3))
    at = (pixels - 0.5).astype(np.float32)
    return cv2.remap(image, at[:, :1], at[:, 1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0] / 255.0
