"""Reference images of the procedural subject, natural or caricatured: supersampled triangles, soft light, shadows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int32

from carigs.capture.camera import Camera
from carigs.capture.images import to_linear
from carigs.exaggeration import Caricature
from carigs.head import HeadParameters, pose
from carigs.mesh import vertex_normals
from carigs.raster import rasterize_mesh
from carigs.toy.look.ambient_visibility import distant_camera
from carigs.toy.look.hair_rendering import ribbon_faces, strand_ribbons
from carigs.toy.look.lighting import StudioLight
from carigs.toy.look.shading import (
    LINEAR_FROM_SRGB,
    SRGB_FROM_LINEAR,
    ambient_by_channel,
    shade,
    shadow_bounds,
    shadow_factors,
)
from carigs.toy.look.shirt import pose_shirt, shade_shirt
from carigs.toy.look.teeth import shade_teeth, teeth_displacement
from carigs.toy.rig.head_model import METRES_PER_MILLIMETRE
from carigs.toy.subject import ToySubject

_SHADOW_SIDE = 256  # pixels of the shadow map
ABOVE_CLOTH = 0.0015
"""Metres above the shirt at which its shadows are looked up, as those of the head are."""


@dataclass(frozen=True)
class PosedSubject:
    """The subject at one timestep under one light: everything that its images from all cameras share."""

    subject: ToySubject
    light: StudioLight
    head: Float[np.ndarray, "v 3"]
    """World positions in metres, as those of the teeth."""
    teeth: Float[np.ndarray, "t 3"]
    head_normals: Float[np.ndarray, "v 3"]
    teeth_colours: Float[np.ndarray, "t 3"]
    hair: tuple[Any, ...]
    """The first arguments of `strand_ribbons`."""
    faces: Int32[np.ndarray, "f 3"]
    """Of head, teeth, hair and shirt."""
    shirt: Float[np.ndarray, "c 3"]
    """World positions in metres; none without a shirt."""
    shirt_colours: Float32[np.ndarray, "c 3"]
    """Linear colours."""
    shadow: Float[np.ndarray, "s s"]
    """Shadow map: depth seen from the key light in metres."""
    shadow_bounds: Float[np.ndarray, "2 b b"]
    shadow_from_world: Float[np.ndarray, "3 4"]

    def render(self, camera: Camera) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Render the image of a camera.

        Args:
            camera: The camera; lengths in metres.

        Returns:
            Colours (sRGB in [0, 1]) over a white background, and coverage in [0, 1].
        """
        subject = self.subject
        ribbons, hair_colours = strand_ribbons(*self.hair, camera.centre, self.light)
        positions = np.concatenate([self.head, self.teeth, ribbons, self.shirt])
        fragments = rasterize_mesh(positions, self.faces, camera.scaled(subject.supersampling))
        return shade(
            fragments.face, fragments.barycentric, self.faces, len(subject.model.faces), positions, self.head_normals,
            ambient_by_channel(subject.ambient_visibility), *subject.atlas,
            np.concatenate([self.teeth_colours.astype(np.float32), hair_colours, self.shirt_colours]), camera.centre,
            self.light.coefficients, self.shadow, self.shadow_bounds, self.shadow_from_world, subject.supersampling,
            LINEAR_FROM_SRGB, SRGB_FROM_LINEAR,
        )  # fmt: skip


def pose_subject(
    subject: ToySubject,
    parameters: HeadParameters,
    caricature: Caricature | None = None,
    *,
    world_from_light: Float[np.ndarray, "3 3"] | None = None,
) -> PosedSubject:
    """Pose the subject and cast its shadows.

    Args:
        subject: The subject.
        parameters: Identity, expression and pose of the head.
        caricature: Added to the head as by `carigs.head.pose`. Texture, hair and teeth follow the surface, a shirt does
            not; light and shadows are those of the new surface.
        world_from_light: Rotation of the studio's light; None: not rotated.

    Returns:
        The posed subject, to be rendered from any number of cameras.
    """
    light = StudioLight() if world_from_light is None else StudioLight(world_from_light)
    if caricature is None:
        caricature = Caricature(np.zeros(subject.model.v_template.shape))
    head, teeth = _pose(subject, parameters, caricature)
    head_faces, strands = subject.model.faces, subject.strands
    hair_faces = ribbon_faces(*strands.local.shape[:2], len(head) + len(teeth))
    faces = np.concatenate([head_faces, subject.teeth_faces + np.int32(len(head)), hair_faces])
    shirt = np.zeros((0, 3))
    if subject.shirt is not None:
        shirt = pose_shirt(subject.shirt, subject.model, parameters)
        first = len(head) + len(teeth) + 2 * strands.local.shape[0] * strands.local.shape[1]
        faces = np.concatenate([faces, subject.shirt.faces + np.int32(first)])
    roots = np.einsum("si,sij->sj", strands.barycentric, head[head_faces[strands.face]])
    hair = (strands, to_linear(strands.colour), roots, subject.strand_frames(head), METRES_PER_MILLIMETRE)
    # A camera at the key light that sees the whole head with its hair.
    middle = 0.5 * (head.min(axis=0) + head.max(axis=0))
    radius = np.linalg.norm(head - middle, axis=1).max() + 0.03
    lamp = distant_camera(middle, radius, light.key_direction, _SHADOW_SIDE)
    ribbons, _ = strand_ribbons(*hair, lamp.centre, light)
    intrinsics = np.array([[lamp.fx, 0, lamp.cx], [0, lamp.fy, lamp.cy], [0, 0, 1]])
    shadow = rasterize_mesh(np.concatenate([head, teeth, ribbons, shirt]), faces, lamp).depth
    bounds, shadow_from_world = shadow_bounds(shadow), intrinsics @ lamp.camera_from_world[:3]
    shirt_colours = np.zeros((0, 3), np.float32)
    if subject.shirt is not None:
        normals = vertex_normals(shirt, subject.shirt.faces)
        lit = shadow_factors(shadow, bounds, shadow_from_world, shirt + ABOVE_CLOTH * normals)
        shirt_colours = shade_shirt(subject.shirt, normals, lit, light)
    return PosedSubject(
        subject=subject,
        light=light,
        head=head,
        teeth=teeth,
        head_normals=vertex_normals(head, head_faces),
        teeth_colours=shade_teeth(subject.teeth_colours, vertex_normals(teeth, subject.teeth_faces), light),
        hair=hair,
        faces=faces,
        shadow=shadow,
        shadow_bounds=bounds,
        shadow_from_world=shadow_from_world,
        shirt=shirt,
        shirt_colours=shirt_colours,
    )


def render_subject(
    subject: ToySubject,
    parameters: HeadParameters,
    camera: Camera,
    caricature: Caricature | None = None,
    *,
    world_from_light: Float[np.ndarray, "3 3"] | None = None,
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """Render one image of the subject. For several cameras, `pose_subject` saves time.

    Args:
        subject: The subject.
        parameters: As of `pose_subject`.
        camera: The camera; lengths in metres.
        caricature: As of `pose_subject`.
        world_from_light: As of `pose_subject`.

    Returns:
        Colours (sRGB in [0, 1]) over a white background, and coverage in [0, 1].
    """
    return pose_subject(subject, parameters, caricature, world_from_light=world_from_light).render(camera)


def _pose(subject: ToySubject, parameters: HeadParameters, caricature: Caricature) -> tuple[np.ndarray, np.ndarray]:
    """World positions of head and teeth, in metres."""
    displacement = teeth_displacement(subject.model, subject.teeth, parameters, caricature.displacement)
    n = len(displacement)
    if parameters.static_offset is not None:  # already part of `displacement`
        parameters = replace(parameters, static_offset=np.pad(parameters.static_offset, ((0, n), (0, 0))))
    changes = caricature.changes
    if changes is not None:  # the motion of the teeth is not caricatured
        changes = np.pad(changes, ((0, 0), (0, n), (0, 0)))
    extended = Caricature(np.concatenate([caricature.displacement, displacement]), caricature.columns, changes)
    posed = pose(subject.model_with_teeth, parameters, extended)
    return posed[:-n], posed[-n:]
