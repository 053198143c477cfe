"""Reprojection of the posed mesh: its silhouette against the mattes, and the colours that cameras show at its vertices.

Hair and shoulders stand off the mesh, so that a pixel of the mesh outside the matte is worse than a pixel of the matte
outside the mesh. The Tversky index (1977) weighs the two; with equal weights it is the intersection over the union.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from carigs.mesh.triangle_mesh import vertex_normals
from carigs.plausibility.scene import Scene, Shot
from carigs.plausibility.vertex_misfit import disagreement, sample
from carigs.plausibility.views import compared_vertices, head_faces
from carigs.raster import compute_visibility
from carigs.raster.vertex_colours import visible_vertices

OFF_MESH = 0.25
"""Weight of matte pixels off the mesh. Long hair makes up a fifth to a third of a matte."""


class Overlap(NamedTuple):
    """Pixels of a frame, or of several."""

    both: int
    """On the mesh and in the matte."""
    outside: int
    """On the mesh above the neck and outside the matte."""
    uncovered: int
    """In the matte and off the mesh."""

    @property
    def misfit(self) -> float:
        """1 - Tversky index: 0 if the silhouette fills the matte, 1 if they do not meet."""
        return 1 - self.both / max(self.both + self.outside + OFF_MESH * self.uncovered, 1)

    @property
    def iou(self) -> float:
        """Intersection over union."""
        return self.both / max(sum(self), 1)

    @property
    def outside_share(self) -> float:
        """Share of the silhouette outside the matte; 1 if there is no silhouette."""
        return self.outside / (self.both + self.outside) if self.both + self.outside else 1.0


class Reprojection(NamedTuple):
    """How well a scene fits its images."""

    overlaps: list[Overlap]
    """Of each shot."""
    colour: float
    """Mean difference of the cameras' colours at the vertices, in levels of 255; NaN if too few vertices are shared."""

    @property
    def overlap(self) -> Overlap:
        """Of all shots."""
        return Overlap(*map(sum, zip(*self.overlaps, strict=True)))

    @property
    def silhouette(self) -> float:
        """Mean misfit of the shots."""
        return float(np.mean([overlap.misfit for overlap in self.overlaps]))


def reproject(scene: Scene, *, colours: bool = True) -> Reprojection:
    """Compare the mesh with the images of a scene.

    Args:
        scene: The scene.
        colours: Whether colours are compared as well.

    Returns:
        The comparison.
    """
    model = scene.model
    above_neck, some = head_faces(model), compared_vertices(model)
    normals = {t: vertex_normals(head.vertices, model.faces) for t, head in scene.heads.items()} if colours else {}
    overlaps, samples = [], {}
    for shot in scene.shots:
        vertices = scene.heads[shot.timestep].vertices
        visibility = compute_visibility(vertices, model.faces, shot.camera)
        overlaps.append(silhouette_overlap(visibility.face, shot.matte, above_neck))
        if colours:
            visible = visible_vertices(visibility, vertices, normals[shot.timestep])
            pixels = np.full((len(vertices), 2), np.nan, np.float32)
            pixels[visible.index] = visible.pixels
            samples.setdefault(shot.frame.timestep, []).append(sample(shot.image, pixels[some]))
    values = [disagreement(np.stack(shown)) for shown in samples.values()]
    known = [value for value in values if np.isfinite(value)]
    return Reprojection(overlaps, float(np.mean(known)) if known else float("nan"))


def silhouette_overlap(
    face: np.ndarray, matte: Bool[np.ndarray, "h w"], above_neck: Bool[np.ndarray, " f"]
) -> Overlap:
    """Compare a silhouette with a matte, above the matte's lowest row.

    Args:
        face: Index of the face at each pixel, -1 for none.
        matte: Foreground of the image.
        above_neck: Faces that count outside the matte: mattes of GaussianAvatars end at a line below the head.

    Returns:
        Numbers of pixels.
    """
    rows = np.flatnonzero(matte.any(axis=1))
    end = rows[-1] + 1 if len(rows) else len(matte)
    face, matte = face[:end], matte[:end]
    mesh = face >= 0
    outside = mesh & ~matte & above_neck[face]
    return Overlap(int((mesh & matte).sum()), int(outside.sum()), int((matte & ~mesh).sum()))
