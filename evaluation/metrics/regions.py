"""The regions of a frame over which errors are reported: which pixels are hair, eyes, mouth, outline, ...

Surface regions are sets of triangles, chosen once on the subject's neutral head from the head model's masks and
landmarks, and seen through the mesh posed at the level that is measured; a triangle belongs to a region when all three
corners do.  What lies off the mesh comes from the truth's foreground matte.

| region | pixels |
|---|---|
| `full` | the whole image |
| `head` | foreground of the truth, or mesh |
| `hair` | scalp triangles; foreground off the mesh, above the middle of the neck, 1 px away from other skin |
| `face` | triangles of the `face` mask |
| `eyes` | eyeballs and lids: the eyelid masks, or else the eye region within a quarter of the eyeball's radius |
| `brow` | the `brows` mask, or else a band along landmarks 17-26, 10 % of the eye corners' distance to either side |
| `mouth` | lips, `lip_inside`, and what is seen inside the lips' outer line (landmarks 48-59) |
| `silhouette` | a band around the mesh's outline, where hair does not hide that |
| `skin` | mesh that is none of scalp, eyeballs, mouth, boundary, brow |
| `neck_ear` | neck and ears |
| `head_hm` | head and silhouette without hair and mouth: what alternation can be expected to improve |
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Camera
from carigs.head import HeadModel
from carigs.raster import Fragments

REGIONS = ("full", "head", "hair", "face", "eyes", "brow", "mouth", "silhouette", "skin", "neck_ear", "head_hm")
BROW_LINES = (range(17, 22), range(22, 27))
EYE_CORNERS = (36, 45)
OUTER_LIPS = range(48, 60)
MOUTH_CORNERS = (48, 54)


@dataclass(frozen=True)
class Surface:
    """Triangles of each surface region of one subject, and why the others are not known."""

    faces: dict[str, Bool[np.ndarray, "f"]]
    missing: dict[str, str]
    """Reason for each of `REGIONS` that this head model cannot give."""
    neck: Bool[np.ndarray, "v"]
    outer_lips: tuple[int, ...]
    """Vertex ids around the lips; empty if the model has no landmarks."""


def surface_regions(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> Surface:
    """Find the triangles of every region on the neutral head (metres)."""
    faces, missing = {}, {}

    def take(region: str, *masks: str) -> None:
        absent = [mask for mask in masks if mask not in model.regions]
        if absent:
            missing[region] = f"the head model has no region {' and '.join(absent)}"
        else:
            faces[region] = model.face_region(*masks)

    take("hair", "scalp")
    take("face", "face")
    take("neck_ear", "neck", "left_ear", "right_ear")
    take("mouth", "lips")
    take("eyes", "left_eyeball", "right_eyeball")
    if "mouth" in faces:
        faces["mouth"] |= model.face_region("lip_inside")
    if "eyes" in faces:
        lids = model.face_region("left_eyelid", "right_eyelid")
        faces["eyes"] |= lids if lids.any() else _lids(model, neutral)
    if "brows" in model.regions:
        faces["brow"] = model.face_region("brows")
    elif model.landmarks68 is not None:
        faces["brow"] = _brow_band(model, neutral)
    else:
        missing["brow"] = "the head model has neither a region brows nor landmarks"
    if "hair" in missing:
        missing["skin"] = missing["hair"]
    else:
        others = model.face_region("left_eyeball", "right_eyeball", "boundary") | faces["hair"]
        for region in ("mouth", "brow"):
            others |= faces.get(region, False)
        faces["skin"] = ~others
    unknown = [region for region in ("hair", "mouth") if region in missing]
    if unknown:
        missing["head_hm"] = "; ".join(missing[region] for region in unknown)
    lips = () if model.landmarks68 is None else tuple(int(model.landmarks68[i]) for i in OUTER_LIPS)
    return Surface(faces=faces, missing=missing, neck=model.vertex_region("neck"), outer_lips=lips)


def image_regions(
    surface: Surface,
    vertices: Float[np.ndarray, "v 3"],
    fragments: Fragments,
    camera: Camera,
    foreground: Bool[np.ndarray, "h w"],
    *,
    band: int,
) -> dict[str, Bool[np.ndarray, "h w"]]:
    """Pixels of every region that `surface` knows.

    `vertices` (metres, world) are posed at the level that is measured, `fragments` is what `camera` sees of them,
    `foreground` is the truth's; `band` is the silhouette's half width in pixels.
    """
    mesh = fragments.face >= 0
    on = {region: mesh & inside[fragments.face] for region, inside in surface.faces.items()}
    regions = {"full": np.ones_like(mesh), "head": foreground | mesh}
    regions["silhouette"] = _dilate(mesh, band) & _dilate(~mesh, band)
    if "hair" in on:
        # Within 1 px of the mesh, foreground is the outline's own blur, unless the mesh is scalp there.
        off_mesh = foreground & ~mesh & (~_dilate(mesh, 1) | _dilate(on["hair"], 2))
        hair = on["hair"] | (off_mesh & _above_neck(surface, vertices, camera))
        regions["hair"] = hair
        regions["silhouette"] &= ~_dilate(hair, band)
    if "mouth" in on:
        regions["mouth"] = on["mouth"] | _between_lips(surface, vertices, fragments, camera)
    for region in ("face", "eyes", "brow", "neck_ear"):
        if region in on:
            regions[region] = on[region]
    if "skin" in on:
        regions["skin"] = on["skin"] & ~regions.get("mouth", np.zeros_like(mesh))
    if "head_hm" not in surface.missing:
        regions["head_hm"] = (regions["head"] | regions["silhouette"]) & ~regions["hair"] & ~regions["mouth"]
    return regions


def _lids(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> Bool[np.ndarray, "f"]:
    """Triangles of the eye regions that lie close to an eyeball: found by distance, so that closed eyes count too."""
    near = np.zeros(len(neutral), bool)
    for side in ("left", "right"):
        ball = neutral[model.vertex_region(f"{side}_eyeball")]
        low, high = ball.min(axis=0), ball.max(axis=0)
        radius = 0.5 * float((high - low).max())
        distance = np.linalg.norm(neutral - 0.5 * (low + high), axis=1)
        near |= model.vertex_region(f"{side}_eye_region", "eye_region") & (distance < 1.25 * radius)
    return near[model.faces].all(axis=1)


def _brow_band(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> Bool[np.ndarray, "f"]:
    corners = neutral[model.landmarks68[list(EYE_CORNERS)]]
    width = 0.1 * float(np.linalg.norm(corners[1] - corners[0]))
    distance = np.full(len(neutral), np.inf)
    for line in BROW_LINES:
        points = neutral[model.landmarks68[list(line)]]
        for start, end in pairwise(points):
            along = np.clip((neutral - start) @ (end - start) / max(float((end - start) @ (end - start)), 1e-12), 0, 1)
            distance = np.minimum(distance, np.linalg.norm(neutral - start - along[:, None] * (end - start), axis=1))
    near = (distance < width) & ~model.vertex_region("left_eyeball", "right_eyeball")
    return near[model.faces].all(axis=1)


def _above_neck(surface: Surface, vertices: np.ndarray, camera: Camera) -> Bool[np.ndarray, "h 1"]:
    """Image rows above the middle of the neck; all of them if the model does not say where that is."""
    rows = np.arange(camera.height)[:, None] + 0.5
    if not surface.neck.any():
        return np.ones_like(rows, bool)
    pixel, _ = camera.project(vertices[surface.neck].mean(axis=0, keepdims=True))
    return rows < pixel[0, 1]


def _between_lips(
    surface: Surface, vertices: np.ndarray, fragments: Fragments, camera: Camera
) -> Bool[np.ndarray, "h w"]:
    """Pixels inside the outer line of the lips, unless something well in front of the lips hides them."""
    inside = np.zeros(fragments.face.shape, np.uint8)
    if not surface.outer_lips:
        return inside > 0
    lips = vertices[list(surface.outer_lips)]
    pixel, depth = camera.project(lips)
    if not (depth > 0).all():
        return inside > 0
    cv2.fillPoly(inside, [np.rint(pixel - 0.5).astype(np.int32)], 1)
    left, right = (lips[corner - OUTER_LIPS[0]] for corner in MOUTH_CORNERS)
    return (inside > 0) & (fragments.depth > depth.mean() - np.linalg.norm(right - left))


def _dilate(mask: Bool[np.ndarray, "h w"], radius: int) -> Bool[np.ndarray, "h w"]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), disc) > 0
