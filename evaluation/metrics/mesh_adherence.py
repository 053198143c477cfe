"""How closely the rendered surface follows the caricature mesh: depth, normals, silhouette and holes.

Surfels that the mesh hides are left out (`not_hidden`). Through a face of opacity 0.98 the back of the head adds 2 % of
its distance to the mean depth, several millimetres; and what is seen through the face is a hole, whatever is behind it.

A surfel's depth is that of its centre, and its pixels share one normal: where the mesh is seen at a grazing angle, or
bends within a surfel, an avatar that lies on the mesh has errors above 0, too. Compare avatars with each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from carigs.raster import Visibility

OPAQUE = 0.5
"""Opacity above which a pixel shows the avatar: the threshold of silhouettes, and of depth and normals."""
HIDDEN = 0.02
"""Metres behind the surface that the mesh shows from which a surfel counts as hidden."""


class RenderedSurface(NamedTuple):
    """Geometry that the rasteriser gives besides the colour: sums over the surfels of a pixel that are `not_hidden`."""

    alpha: Float32[np.ndarray, "h w"]
    depth: Float32[np.ndarray, "h w"]
    """Depth along the optical axis in metres, times alpha."""
    normal: Float32[np.ndarray, "h w 3"]
    """Unit normals in camera axes that face the camera, times their weights."""


class AdherenceMaps(NamedTuple):
    """Errors of the rendered surface at every pixel."""

    depth_error: Float32[np.ndarray, "h w"]
    """Absolute difference of depth in millimetres; nan where the mesh or the avatar is not seen."""
    normal_error: Float32[np.ndarray, "h w"]
    """Angle between the normals in degrees; nan as above."""
    transparency: Float32[np.ndarray, "h w"]
    """1 - alpha."""


def not_hidden(centres: Float[np.ndarray, "n 3"], visibility: Visibility) -> Bool[np.ndarray, " n"]:
    """Find the surfels that the mesh does not hide.

    Args:
        centres: Surfels in world coordinates, in metres.
        visibility: The mesh as the camera sees it.

    Returns:
        False for surfels more than `HIDDEN` behind the surface that the pixel of their centre shows.
    """
    height, width = visibility.face.shape
    pixels, depth = visibility.camera.project(centres)
    inside = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < [width, height]).all(axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(int).T
    # The inverse depth is 0 off the mesh: nothing is hidden there.
    return ~(inside & ((depth - HIDDEN) * visibility.inverse_depth[row, column] > 1))


def adherence_maps(surface: RenderedSurface, visibility: Visibility) -> AdherenceMaps:
    """Compare the rendered surface with the mesh, pixel by pixel.

    Args:
        surface: Rendered geometry.
        visibility: The mesh at the rendered level, as the same camera sees it.

    Returns:
        The errors.
    """
    shown = (visibility.face >= 0) & (surface.alpha > OPAQUE)
    depth_error, normal_error = (np.full(shown.shape, np.nan, np.float32) for _ in range(2))
    depth = surface.depth[shown] / surface.alpha[shown]
    depth_error[shown] = 1000 * np.abs(depth - 1 / visibility.inverse_depth[shown])
    normal = surface.normal[shown]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    chord = np.linalg.norm(normal - facing_normals(visibility)[visibility.face[shown]], axis=1)
    normal_error[shown] = np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1)))  # exact for small angles, unlike arccos
    return AdherenceMaps(depth_error, normal_error, 1 - surface.alpha)


def facing_normals(visibility: Visibility) -> Float64[np.ndarray, "f 3"]:
    """Unit normals of the faces in camera axes, turned towards the camera.

    The plane n.x = 1 of a face has the inverse depth n.d at the ray d, which `Visibility.depth_planes` holds as a
    function of the image position.

    Args:
        visibility: The mesh as the camera sees it.

    Returns:
        Normals; 0 for faces that are seen edge-on.
    """
    fx, fy, cx, cy = visibility.camera.intrinsics
    x, y, constant = visibility.depth_planes.T
    normals = -np.stack([fx * x, fy * y, constant + cx * x + cy * y], axis=1)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def silhouette_ious(
    alpha: Float[np.ndarray, "h w"],
    mesh: Bool[np.ndarray, "h w"],
    regions: Mapping[str, Bool[np.ndarray, "h w"]],
) -> dict[str, float]:
    """Intersection over union of the avatar's silhouette and the mesh's.

    A pixel off the mesh belongs to the region of the nearest pixel on the mesh. In the region `skin`, hair that stands
    out and what hangs below the neck are left out so, because scalp and border of the neck are not skin.

    Args:
        alpha: Opacity of the rendered avatar.
        mesh: Whether a pixel shows the mesh.
        regions: Parts of the mesh.

    Returns:
        The ratio by region; nan for a region that is not in view.
    """
    avatar = alpha > OPAQUE
    if not mesh.any():
        return dict.fromkeys(regions, float("nan"))
    # Each pixel off the mesh gets the label of the nearest pixel on it.
    labels = cv2.distanceTransformWithLabels(
        (~mesh).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    in_region = np.zeros(labels.max() + 1, bool)
    ious = {}
    for name, region in regions.items():
        in_region[labels[mesh]] = region[mesh]
        here = in_region[labels]
        union = np.count_nonzero(here & (avatar | mesh)) if region.any() else 0
        ious[name] = float(np.count_nonzero(here & avatar & mesh) / union) if union else float("nan")
    return ious


def mesh_adherence(
    surface: RenderedSurface, visibility: Visibility, regions: Mapping[str, Bool[np.ndarray, "h w"]]
) -> dict[tuple[str, str], float]:
    """Measure how closely the rendered surface follows the mesh.

    Args:
        surface: Rendered geometry.
        visibility: The mesh at the rendered level, as the same camera sees it.
        regions: Parts of the mesh, as of `evaluation.metrics.regions.mesh_regions`.

    Returns:
        By region and metric: `depth_error` (mean, millimetres) and `normal_error` (mean, degrees) where the opacity is
        above `OPAQUE`, `hole_rate` (mean of 1 - alpha) and `silhouette_iou`; nan where there is no such pixel.
    """
    maps, values = adherence_maps(surface, visibility), {}
    means = {"depth_error": maps.depth_error, "normal_error": maps.normal_error, "hole_rate": maps.transparency}
    for region, inside in regions.items():
        for metric, errors in means.items():
            here = errors[inside]
            here = here[np.isfinite(here)]
            values[region, metric] = float(here.mean(dtype=np.float64)) if here.size else float("nan")
    ious = silhouette_ious(surface.alpha, visibility.face >= 0, regions)
    return values | {(region, "silhouette_iou"): iou for region, iou in ious.items()}
