"""Reprojection of the posed mesh: its silhouette against the mattes, and the colours that cameras show at its vertices.

Hair and shoulders stand off the mesh, so that a pixel of the mesh outside the matte is worse than a pixel of the matte
off the mesh. The Tversky index (1977) weighs the two; with equal weights it is the intersection over the union.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32

from carigs.plausibility.diagnosis.scene import Scene, Shot
from carigs.plausibility.vertex_misfit import CLIP, LEAST_FRAMES, disagreement, sample_inside
from carigs.plausibility.views import head_faces, spread_vertices
from carigs.raster import Visibility, compute_visibility
from carigs.raster.vertex_colours import visible_vertices

OFF_MESH = 0.25
"""Weight of matte pixels off the mesh. Long hair makes up a fifth to a third of a matte."""


class Overlap(NamedTuple):
    """Numbers of pixels."""

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

    @property
    def uncovered_share(self) -> float:
        """Share of the matte off the mesh."""
        return self.uncovered / max(self.both + self.uncovered, 1)


class Reprojection(NamedTuple):
    """How well a scene fits its images."""

    overlaps: dict[Shot, Overlap]
    """Of the shots with a matte."""
    colour: float
    """Mean difference between frames in the colours at the vertices, in levels of 255: see `colour_disagreement`."""

    @property
    def silhouette(self) -> float:
        """Mean misfit of the shots; 0 without mattes."""
        return self.silhouette_of(frozenset())

    @property
    def outside_share(self) -> float:
        """Share of all silhouettes outside the mattes."""
        return total_overlap(self.overlaps.values()).outside_share

    def silhouette_of(self, cameras: frozenset[int]) -> float:
        """Mean misfit of the shots of some cameras.

        Args:
            cameras: Numbers of the cameras; empty for all.

        Returns:
            The misfit; 0 without mattes.
        """
        misfits = [o.misfit for shot, o in self.overlaps.items() if not cameras or shot.frame.camera in cameras]
        return float(np.mean(misfits)) if misfits else 0.0


def total_overlap(overlaps: Iterable[Overlap]) -> Overlap:
    """Add numbers of pixels.

    Args:
        overlaps: Of several frames.

    Returns:
        The sums.
    """
    return Overlap(*np.sum(list(overlaps) or [(0, 0, 0)], axis=0).tolist())


def reproject(scene: Scene, *, colours: bool = True) -> Reprojection:
    """Compare the mesh with the images of a scene.

    Args:
        scene: The scene.
        colours: Whether colours are compared as well.

    Returns:
        The comparison.
    """
    above_neck, overlaps, samples = head_faces(scene.model), {}, {}
    for shot in scene.shots:
        head = scene.heads[shot.timestep]
        visibility = compute_visibility(head.vertices, scene.model.faces, shot.image_camera)
        if shot.matte is not None:
            overlaps[shot] = silhouette_overlap(visibility.face, shot.matte, above_neck)
        if colours:
            samples[shot] = _foreground_colours(shot, vertex_pixels(scene, shot, visibility))
    return Reprojection(overlaps, colour_disagreement(samples) if colours else CLIP)


def _foreground_colours(shot: Shot, pixels: Float32[np.ndarray, "n 2"]) -> Float32[np.ndarray, "n 3"]:
    """Colours at positions in the matte; NaN at others: the background has the same colour in all images."""
    colours = sample_inside(shot.image, pixels)
    if shot.matte is not None:
        known = np.flatnonzero(np.isfinite(colours[:, 0]))
        column, row = pixels[known].astype(int).T
        colours[known[~shot.matte[row, column]]] = np.nan
    return colours


def vertex_pixels(scene: Scene, shot: Shot, visibility: Visibility) -> Float32[np.ndarray, "n 2"]:
    """Where a shot shows the vertices whose colours are compared.

    Args:
        scene: The scene.
        shot: One of its shots.
        visibility: What the shot's camera sees.

    Returns:
        Positions in the reduced image; NaN for hidden vertices.
    """
    head = scene.heads[shot.timestep]
    pixels = np.full((len(head.vertices), 2), np.nan, np.float32)
    visible = visible_vertices(visibility, head.vertices, head.normals)
    pixels[visible.index] = visible.pixels
    return pixels[spread_vertices(scene.model)]


def colour_disagreement(samples: dict[Shot, Float32[np.ndarray, "n 3"]]) -> float:
    """Mean difference of the colours at the vertices, between cameras at a timestep and between timesteps of a camera.

    Args:
        samples: Colours by shot; NaN where a vertex is hidden.

    Returns:
        Levels of 255; `CLIP` if no vertex is seen often enough, 0 if there are too few shots to compare.
    """
    groups: dict[tuple[str, int], list[Float32[np.ndarray, "n 3"]]] = {}
    for shot, colours in samples.items():
        groups.setdefault(("timestep", shot.frame.timestep), []).append(colours)
        groups.setdefault(("camera", shot.frame.camera), []).append(colours)
    groups = {key: group for key, group in groups.items() if len(group) >= LEAST_FRAMES}
    values = [disagreement(np.stack(group)) for group in groups.values()]
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else CLIP * bool(groups)


def silhouette_overlap(
    face: Int32[np.ndarray, "h w"], matte: Bool[np.ndarray, "h w"], above_neck: Bool[np.ndarray, " f"]
) -> Overlap:
    """Compare a silhouette with a matte, down to the matte's lowest row: mattes may end at a line below the head.

    Args:
        face: Index of the face at each pixel, -1 for none.
        matte: Foreground of the image.
        above_neck: Faces that mattes show in any case.

    Returns:
        Numbers of pixels.
    """
    rows = np.flatnonzero(matte.any(axis=1))
    end = rows[-1] + 1 if len(rows) else len(matte)
    face, matte = face[:end], matte[:end]
    mesh = face >= 0
    outside = mesh & ~matte & above_neck[face]
    return Overlap(int((mesh & matte).sum()), int(outside.sum()), int((matte & ~mesh).sum()))
