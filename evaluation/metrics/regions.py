"""Image regions over which errors are reported: hair, eyes, mouth, silhouette and others.

Surface regions are sets of triangles, found once on the subject's neutral head from the head model's masks and
landmarks. They are projected with the mesh posed at the rendered level. A triangle belongs to a region if all three
corners do. Pixels off the mesh are assigned by the foreground matte of the true image.

| region | pixels |
|---|---|
| `full` | the whole image |
| `head` | foreground of the truth, or mesh |
| `hair` | scalp triangles; foreground off the mesh, above the middle of the neck, at least 1 px from other skin |
| `face` | triangles of the `face` mask |
| `eyes` | eyeballs and lids: the eyelid masks, or else the eye region within a quarter of the eyeball's radius |
| `brow` | the `brows` mask, or else a band along landmarks 17-26, 10 % of the eye corners' distance to either side |
| `mouth` | lips, `lip_inside`, and pixels inside the outer line of the lips (landmarks 48-59) |
| `silhouette` | a band around the outline of the mesh, outside hair |
| `skin` | mesh without scalp, eyeballs, mouth, boundary, brow |
| `neck_ear` | neck and ears |
| `head_hm` | head and silhouette without hair and mouth: the region that alternation can improve |

Metrics that compare with the mesh alone (`mesh_regions`) know no pixels off it: their `full` is the whole mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.capture import Camera
from carigs.head import HeadModel, SurfacePoints
from carigs.head.facial_regions import brow_faces, lid_faces
from carigs.raster import Fragments

MESH_REGIONS = ("full", "face", "skin")
"""Regions of metrics that compare with the mesh alone. Hair stands off the mesh; face and skin do not."""
OUTER_LIPS = range(48, 60)
MOUTH_CORNERS = (48, 54)


@dataclass(frozen=True)
class SurfaceRegions:
    """Triangles of each surface region of one subject."""

    faces: dict[str, Bool[np.ndarray, " f"]]
    missing: dict[str, str]
    """Reasons for regions that the head model does not define."""
    neck: Bool[np.ndarray, " v"]
    outer_lips: SurfacePoints | None
    """Points around the lips; None if the model has no landmarks."""


def surface_regions(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> SurfaceRegions:
    """Find the triangles of every region on the neutral head.

    Args:
        model: Head model with named regions and landmarks.
        neutral: Vertices of the subject's neutral head in metres.

    Returns:
        Triangles by region.
    """
    faces, missing = {}, {}

    def add(region: str, *masks: str) -> None:
        absent = [mask for mask in masks if mask not in model.regions]
        if absent:
            missing[region] = f"the head model has no region {' and '.join(absent)}"
        else:
            faces[region] = model.face_region(*masks)

    add("hair", "scalp")
    add("face", "face")
    add("neck_ear", "neck", "left_ear", "right_ear")
    add("mouth", "lips")
    add("eyes", "left_eyeball", "right_eyeball")
    if "mouth" in faces:
        faces["mouth"] |= model.face_region("lip_inside")
    if "eyes" in faces:
        faces["eyes"] |= lid_faces(model, neutral)
    if (brows := brow_faces(model, neutral)) is not None:
        faces["brow"] = brows
    else:
        missing["brow"] = "the head model has neither a region brows nor landmarks"
    if "hair" in missing:
        missing["skin"] = missing["hair"]
    else:
        others = model.face_region("left_eyeball", "right_eyeball", "boundary") | faces.get("mouth", False)
        faces["skin"] = ~(others | faces["hair"] | faces.get("brow", False))
    unknown = [region for region in ("hair", "mouth") if region in missing]
    if unknown:
        missing["head_hm"] = "; ".join(missing[region] for region in unknown)
    lips = None if model.landmarks68 is None else model.landmarks68[OUTER_LIPS]
    return SurfaceRegions(faces=faces, missing=missing, neck=model.vertex_region("neck"), outer_lips=lips)


def mesh_regions(surface: SurfaceRegions, face: Int[np.ndarray, "h w"]) -> dict[str, Bool[np.ndarray, "h w"]]:
    """Assign the pixels that show the mesh to regions, for metrics that compare nothing else.

    Args:
        surface: Triangles of each region.
        face: Nearest face at every pixel, -1 where there is none.

    Returns:
        Mask of each of `MESH_REGIONS` that the head model defines; `full` is the whole mesh.
    """
    mesh = face >= 0
    return {"full": mesh} | {
        region: mesh & surface.faces[region][face] for region in MESH_REGIONS if region in surface.faces
    }


def image_regions(
    surface: SurfaceRegions,
    vertices: Float[np.ndarray, "v 3"],
    fragments: Fragments,
    camera: Camera,
    foreground: Bool[np.ndarray, "h w"],
    *,
    band: int,
) -> dict[str, Bool[np.ndarray, "h w"]]:
    """Assign the pixels of a frame to regions, which overlap.

    Args:
        surface: Triangles of each region.
        vertices: Mesh posed at the rendered level (world frame, metres).
        fragments: Rasterized mesh.
        camera: Camera of the frame.
        foreground: Foreground of the true image.
        band: Half width of the silhouette in pixels.

    Returns:
        Mask of each region that the head model defines.
    """
    mesh = fragments.face >= 0
    on_mesh = {region: mesh & inside[fragments.face] for region, inside in surface.faces.items()}
    regions = {"full": np.ones_like(mesh), "head": foreground | mesh}
    regions["silhouette"] = _dilate(mesh, band) & _dilate(~mesh, band)
    if "hair" in on_mesh:
        # Within 1 px of the mesh, foreground is the blur of the outline, unless the mesh is scalp there.
        off_mesh = foreground & ~mesh & (~_dilate(mesh, 1) | _dilate(on_mesh["hair"], 2))
        regions["hair"] = on_mesh["hair"] | (off_mesh & _above_neck(surface, vertices, camera))
        regions["silhouette"] &= ~_dilate(regions["hair"], band)
    if "mouth" in on_mesh:
        regions["mouth"] = on_mesh["mouth"] | _between_lips(surface, vertices, fragments, camera)
    regions |= {region: on_mesh[region] for region in ("face", "eyes", "brow", "neck_ear") if region in on_mesh}
    if "skin" in on_mesh:
        regions["skin"] = on_mesh["skin"] & ~regions.get("mouth", np.zeros_like(mesh))
    if "head_hm" not in surface.missing:
        regions["head_hm"] = (regions["head"] | regions["silhouette"]) & ~regions["hair"] & ~regions["mouth"]
    return regions


def _above_neck(surface: SurfaceRegions, vertices: np.ndarray, camera: Camera) -> Bool[np.ndarray, "h 1"]:
    """Mask of the image rows above the middle of the neck; all of them if the model has no neck region."""
    y = np.arange(camera.height)[:, None] + 0.5
    if not surface.neck.any():
        return np.ones_like(y, bool)
    pixel, _ = camera.project(vertices[surface.neck].mean(axis=0, keepdims=True))
    return y < pixel[0, 1]


def _between_lips(
    surface: SurfaceRegions, vertices: np.ndarray, fragments: Fragments, camera: Camera
) -> Bool[np.ndarray, "h w"]:
    """Pixels inside the outer line of the lips that nothing well in front of the lips hides."""
    inside = np.zeros(fragments.face.shape, np.uint8)
    if surface.outer_lips is None:
        return inside > 0
    lips = surface.outer_lips.interpolate(vertices)
    pixel, depth = camera.project(lips)
    if not (depth > 0).all():
        return inside > 0
    cv2.fillPoly(inside, [np.rint(pixel - 0.5).astype(np.int32)], 1)
    left, right = (lips[corner - OUTER_LIPS[0]] for corner in MOUTH_CORNERS)
    return (inside > 0) & (fragments.depth > depth.mean() - np.linalg.norm(right - left))


def _dilate(mask: Bool[np.ndarray, "h w"], radius: int) -> Bool[np.ndarray, "h w"]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), disc) > 0
