"""The local affine warp: every pixel of the caricature fetches its colour from the real frame."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.capture import Camera
from carigs.raster import Fragments, rasterize_mesh


class Warp(NamedTuple):
    """A frame warped onto the caricature, with what the masks need to judge it."""

    colour: Float32[np.ndarray, "h w 3"]
    """Warped colours on the caricature mesh, background elsewhere: the warp knows nothing of what is off the mesh."""
    source_pixel: Float32[np.ndarray, "h w 2"]
    """Where in the frame each mesh pixel came from (x, y; pixel centres at +0.5); nan off the mesh."""
    source_depth: Float32[np.ndarray, "h w"]
    """Depth of that point on the natural surface; nan off the mesh."""
    natural: Fragments
    caricature: Fragments
    natural_pixel: Float[np.ndarray, "v 2"]
    """The vertices' pixels in the frame."""
    caricature_pixel: Float[np.ndarray, "v 2"]


def warp_frame(
    image: Float32[np.ndarray, "h w 3"],
    natural_vertices: Float[np.ndarray, "v 3"],
    caricature_vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
    background: float = 1.0,
) -> Warp:
    """Warp a frame by the per-triangle affine maps between the two projected meshes (paper, equation 5).

    The map of a triangle is affine exactly if it keeps the barycentric coordinates of the *projected* triangles; the
    inverse map sends each caricature pixel to the frame, sampled bilinearly.  Vertices are world points in metres.
    """
    natural = rasterize_mesh(natural_vertices, faces, camera)
    caricature = rasterize_mesh(caricature_vertices, faces, camera)
    covered = caricature.face >= 0
    corners = faces[caricature.face[covered]]  # (p, 3)

    natural_pixel, natural_depth = camera.project(natural_vertices)
    caricature_pixel, caricature_depth = camera.project(caricature_vertices)
    # Perspective-correct weights times the corners' depths are, up to their sum, the weights in the image plane.
    weights = caricature.barycentric[covered] * caricature_depth[corners]
    weights /= weights.sum(axis=1, keepdims=True)

    source_pixel = np.full((*covered.shape, 2), np.nan, np.float32)
    source_depth = np.full(covered.shape, np.nan, np.float32)
    source_pixel[covered] = np.einsum("pc,pcx->px", weights, natural_pixel[corners])
    # Inverse depth is affine in the image plane.
    with np.errstate(divide="ignore"):
        source_depth[covered] = 1.0 / np.einsum("pc,pc->p", weights, 1.0 / natural_depth[corners])

    where = np.where(covered[..., None], source_pixel - np.float32(0.5), 0)  # remap counts pixel centres from 0
    colour = cv2.remap(image, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colour = np.where(covered[..., None], colour, np.float32(background))
    return Warp(colour, source_pixel, source_depth, natural, caricature, natural_pixel, caricature_pixel)
