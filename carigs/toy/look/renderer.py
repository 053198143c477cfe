"""True images of the procedural person, natural or caricatured: supersampled triangles, soft light, shadows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture.camera import Camera
from carigs.capture.images import to_linear
from carigs.exaggeration import Caricature
from carigs.head import HeadParameters, pose
from carigs.raster import rasterize_mesh
from carigs.toy.look.exposure import distant_camera, vertex_normals
from carigs.toy.look.hair import frames
from carigs.toy.look.lighting import AMBIENT_SQUARE, Light
from carigs.toy.look.ribbons import comb, ribbon_faces
from carigs.toy.look.shading import LINEAR, STORED, bounced, shade
from carigs.toy.look.teeth import follow, lit
from carigs.toy.rig.head_model import MILLIMETRE
from carigs.toy.subject import Subject

_SHADOW = 256  # pixels of the shadow map


def render_subject(
    subject: Subject,
    parameters: HeadParameters,
    camera: Camera,
    caricature: Caricature | None = None,
    *,
    world_from_light: Float[np.ndarray, "3 3"] | None = None,
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """Colour over white and coverage of one frame.

    `caricature` is added to the head as by `pose`: texture, hair and teeth are carried along, light and shadows are
    those of the new surface.  The studio's light is fixed to the world;
    `world_from_light` turns it.
    """
    light = Light() if world_from_light is None else Light(world_from_light)
    if caricature is None:
        caricature = Caricature(np.zeros(subject.model.v_template.shape))
    skin, mouth = _pose(subject, parameters, caricature)
    faces, strands = subject.model.faces, subject.strands
    first = len(skin) + len(mouth)  # vertex of the hair
    corners = np.concatenate(
        [faces, subject.teeth_faces + np.int32(len(skin)), ribbon_faces(*strands.local.shape[:2], first)]
    )
    roots = np.einsum("si,sij->sj", strands.barycentric, skin[faces[strands.face]])
    axes = frames(skin, faces)[strands.face]
    hair_colour = to_linear(strands.colour)
    lamp = _lamp(skin, light.key)
    hair, _ = comb(strands, hair_colour, roots, axes, MILLIMETRE, lamp.centre, light)
    shadow = rasterize_mesh(np.concatenate([skin, mouth, hair]), corners, lamp).depth
    hair, hair_colours = comb(strands, hair_colour, roots, axes, MILLIMETRE, camera.centre, light)
    teeth_colours = lit(subject.teeth_colours, vertex_normals(mouth, subject.teeth_faces), light)
    positions = np.concatenate([skin, mouth, hair])
    fragments = rasterize_mesh(positions, corners, camera.scaled(subject.supersampling))
    return shade(
        fragments.face, fragments.barycentric, corners, len(faces), positions, vertex_normals(skin, faces),
        bounced(subject.exposure), subject.atlas.first, subject.atlas.resolution, subject.atlas.texels,
        np.concatenate([teeth_colours.astype(np.float32), hair_colours]), camera.centre, light.rows, AMBIENT_SQUARE,
        shadow, _pixel_from_world(lamp), subject.supersampling, LINEAR, STORED,
    )  # fmt: skip


def _pose(
    subject: Subject, parameters: HeadParameters, caricature: Caricature
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "t 3"]]:
    """Skin and teeth in the world."""
    moved = follow(subject.model, subject.teeth, parameters, caricature.displacement)
    if parameters.static_offset is not None:  # `follow` has seen it already
        parameters = replace(parameters, static_offset=np.pad(parameters.static_offset, ((0, len(moved)), (0, 0))))
    v, changes = len(caricature.displacement), caricature.changes
    if changes is not None:
        changes = np.pad(changes, ((0, 0), (0, len(moved)), (0, 0)))  # teeth move as they naturally do
    whole = Caricature(np.concatenate([caricature.displacement, moved]), caricature.columns, changes)
    posed = pose(subject.posed_model, parameters, whole)
    return posed[:v], posed[v:]


def _lamp(skin: Float[np.ndarray, "v 3"], key: Float[np.ndarray, "3"]) -> Camera:
    """A camera at the key light that sees the whole head with its hair."""
    middle = 0.5 * (skin.min(axis=0) + skin.max(axis=0))
    return distant_camera(middle, np.linalg.norm(skin - middle, axis=1).max() + 0.03, key, _SHADOW)


def _pixel_from_world(camera: Camera) -> Float[np.ndarray, "3 4"]:
    intrinsic = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    return intrinsic @ camera.camera_from_world[:3]
