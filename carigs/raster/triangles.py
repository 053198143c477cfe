"""The triangle rasteriser: what a camera sees of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt64

from carigs.raster import bit_masks as bits
from carigs.raster import coverage
from carigs.raster import visibility as scan
from carigs.raster.bit_masks import Bits

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

NEAR = 0.01  # metres: what is nearer than this is cut off


class Fragments(NamedTuple):
    """What a pixel's centre ray hits first."""

    face: Int32[np.ndarray, "h w"]
    """Index of the nearest face, -1 where there is none."""
    barycentric: Float32[np.ndarray, "h w 3"]
    """Perspective-correct weights of the face's corners: weights @ corners is the 3D point hit."""
    depth: Float32[np.ndarray, "h w"]
    """Depth along the optical axis in metres, inf where there is no face."""


class Coverage(NamedTuple):
    """How much of each pixel on an outline is covered where it is not all; all of every other one."""

    partly: UInt64[np.ndarray, "j w"]
    """Those pixels, as words of `Bits`."""
    first: Int32[np.ndarray, "j w"]
    """Number of the first pixel of each word."""
    share: Float32[np.ndarray, "n"]
    """By number."""

    def image(self, height: int) -> Float32[np.ndarray, "h w"]:
        """The share at every pixel."""
        return coverage.image(*self, height)


@dataclass(frozen=True)
class Visibility:
    """Which face is nearest at every pixel centre, and what it takes to say where on it."""

    face: Int32[np.ndarray, "h w"]
    """Index of the nearest face, -1 where there is none."""
    nearness: Float32[np.ndarray, "h w"]
    """Inverse depth along the optical axis in 1/metres, 0 where there is no face."""
    back: Bool[np.ndarray, "f"]
    """Faces that show the camera their back."""
    slope: Float64[np.ndarray, "f 3"]
    """Inverse depth of each face's plane at the pixel (x, y): slope @ (x, y, 1)."""
    points: Float64[np.ndarray, "v 3"]
    """Vertices in camera axes."""
    pixel: Float64[np.ndarray, "v 2"]
    """Their pixels: without meaning unless their depth is positive."""
    faces: Int32[np.ndarray, "f 3"]
    camera: Camera

    @cached_property
    def on_mesh(self) -> Bits:
        """The pixels with a face."""
        return bits.above(self.face, -1)

    @property
    def fragments(self) -> Fragments:
        """Barycentrics and depth at every pixel."""
        c = self.camera
        weights, depth = scan.locate(self.points, self.faces, self.slope, self.face, c.fx, c.fy, c.cx, c.cy)
        return Fragments(self.face, weights, depth)

    def coverage(self, n: int) -> Coverage:
        """Share of each pixel on the outline (on the mesh, a neighbour off it) that the mesh covers.

        Counted on n x n samples, n <= 8, at least one; with n = 1 all of each.  Faces that reach nearer than `NEAR` are
        left out.
        """
        height, on_mesh = len(self.face), self.on_mesh.words
        outline = np.zeros_like(on_mesh) if n == 1 else coverage.outline(on_mesh, height)
        first, count = coverage.numbered(outline)
        samples = coverage.cover(self.points, self.pixel, self.faces, outline, first, count, n, NEAR, height)
        partly, share = coverage.partly(outline, samples, n)
        return Coverage(partly, coverage.numbered(partly)[0], share)


def visible(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, *, cull_back: bool = False
) -> Visibility:
    """Find the nearest face at every pixel centre.

    Vertices are world points in metres.  Faces are cut at the depth `NEAR`; with `cull_back` those seen from behind
    (clockwise in the image) are left out.  A pixel centre on a shared edge belongs to exactly one of its two faces
    (top-left rule), and neighbours leave no cracks.  Faces that are edge-on or not finite have no pixels.
    """
    c, faces, lens = camera, np.ascontiguousarray(faces, np.int32), _lens(camera)
    points, pixel = project(vertices, camera)
    slope, back = scan.planes(points, faces, *lens)
    face, nearness = scan.scan(points, pixel, faces, slope, back, cull_back, NEAR, *lens, c.height, c.width)
    return Visibility(face, nearness, back, slope, points, pixel, faces, camera)


def project(
    points: Float[np.ndarray, "n 3"], camera: Camera
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 2"]]:
    """World points in camera axes, and their pixels: as `Camera` does it, many times faster."""
    rotation, translation = np.ascontiguousarray(camera.camera_from_world[:3, :3]), camera.camera_from_world[:3, 3]
    return scan.project(np.ascontiguousarray(points, np.float64), rotation, translation.copy(), *_lens(camera))


def _lens(camera: Camera) -> tuple[float, float, float, float]:
    return float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)


def rasterize_mesh(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, *, cull_back: bool = False
) -> Fragments:
    """`visible` with barycentrics and depth of every pixel."""
    return visible(vertices, faces, camera, cull_back=cull_back).fragments
