"""Triangles of a head that something covers in the frames: hair that hangs over the skin, a collar, a hand.

What lies on the mesh has the same colour in all views, up to its shading, which is smooth. What stands off it has a
parallax: each view shows other strands over the same point. So a pixel's difference from the median colour of its
point, without its low frequencies, is the noise of the camera on bare skin, and has the contrast of strands where hair
covers it. The texture of a triangle is a high quantile of this difference over views and over the triangles around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from carigs.hair import surface_cells
from carigs.hair.labels import labelled_as_covered
from carigs.hair.views import HairView

MIN_COSINE = 0.25
"""Least cosine between the normal of a triangle and the view."""
OPAQUE = 250 / 255
"""Least opacity of the matte."""
DEPTH_JUMP = 0.005
"""Metres by which a neighbouring pixel may lie off the plane of a triangle."""
CELL_SIZE = 0.002
"""Metres: larger triangles are divided."""
MIN_SAMPLES = 20
"""Pixels of a cell, over all views, below which it takes the median of the triangles around it."""
BLUR = 0.0015
"""Standard deviation in metres of the low frequencies, at least 1.5 pixels."""
QUANTILE = 0.75
"""Of the differences on a triangle."""
CLEAN_QUANTILE = 0.1
"""Of the textures of all triangles of the face and neck: noise of bare skin."""
LARGEST = 0.25
"""Texture at which its histogram ends."""
BINS = 256
SOLID_SHARE, COLOUR_LIMIT = 0.5, 0.2
"""Texture over its limit, and difference from the colour of clean skin, of a triangle covered by hair without single
strands. Where most of the scalp has that difference, texture does not count."""
HIDDEN_COLOUR = 0.1
"""Difference from the median colour of clean skin of a triangle that most views do not see."""
STRANDS = 0.1
"""Share of a triangle's pixels, over all views, that show strands which cover it."""
LEAST_CONTRAST = 0.15
"""Difference of the colours of hair and skin above which strands are told from skin that the tracking misplaced."""
SPECK = 8e-4
"""Square metres: a smaller connected part does not count as covered."""


class Covering(NamedTuple):
    """What covers the triangles of a head."""

    texture: Float[np.ndarray, " f"]
    """Contrast of what moves against the triangle, without the noise of the images; 0 where no view sees it."""
    colour: Float[np.ndarray, "f 3"]
    """Median colour over the views; nan where no view sees the triangle."""
    covered: Bool[np.ndarray, " f"]
    hidden: Bool[np.ndarray, " f"]
    """The covered triangles whose median colour is not that of clean skin: most views show what covers them."""
    skin: Bool[np.ndarray, " f"]
    """Triangles of clean skin with its usual colour: the others probably have it, too."""

    def opacity(self, limit: float) -> Float32[np.ndarray, " f"]:
        """Opacity of what covers each triangle.

        Args:
            limit: Texture of a covered triangle.

        Returns:
            1 for covered triangles, less for those of less texture.
        """
        return np.where(self.covered, 1, np.minimum(self.texture / max(limit, 1e-9), 1)).astype(np.float32)


def covered_faces(
    views: Sequence[HairView],
    faces: Int[np.ndarray, "f 3"],
    vertices: Float[np.ndarray, "v 3"],
    scalp: Bool[np.ndarray, " f"],
    left_out: Bool[np.ndarray, " f"],
    features: Bool[np.ndarray, " f"],
    limit: float = 0.03,
) -> Covering:
    """Find the triangles that something covers.

    Args:
        views: Frames of several timesteps and cameras.
        faces: Vertex indices of the triangles.
        vertices: Vertices of the subject's neutral head, in metres.
        scalp: Triangles that usually carry hair: the noise of skin is not measured there.
        left_out: Triangles that are not looked at and count as bare: eyeballs, which shine, and the inside of the
            mouth.
        features: Triangles with a texture of their own, such as brows and lids: covered only if labels say so,
            because strands in front of them cannot be told from it, and eyes without any target move wrongly.
        limit: Texture of a covered triangle.

    Returns:
        Texture, colour, and whether a triangle is covered.
    """
    first, parts, count = _divide(vertices, faces)
    component = _components(faces, len(vertices))
    cells = [_cells(view, ~left_out, component, first, parts) for view in views]
    colours = np.zeros((count, 3, surface_cells.BINS), np.uint32)
    for view, shown in zip(views, cells, strict=True):
        surface_cells.add_colours(colours, shown, view.image)
    colour = _face_medians(colours, first, faces, len(vertices))
    median = np.repeat(colour, parts**2, axis=0)
    enough = colours[:, 0].sum(axis=1) >= MIN_SAMPLES
    for k in range(3):
        median[enough, k] = surface_cells.quantiles(colours[enough, k], 0.5)
    differences = np.zeros((len(faces), BINS), np.uint32)
    for view, shown in zip(views, cells, strict=True):
        difference, used = surface_cells.residuals(shown, view.image, median)
        sigma = max(1.5, BLUR / view.visibility.pixel_size)
        low, weight = (cv2.GaussianBlur(image, (0, 0), sigma) for image in (difference, used))
        high = np.abs(difference - low / np.maximum(weight, 1e-6))
        surface_cells.add_values(differences, view.visibility.face, used, high, LARGEST)
    spread = LARGEST * surface_cells.quantiles(_pooled(differences, faces, len(vertices)), QUANTILE)
    skin = np.isfinite(spread) & ~(scalp | left_out | features)
    noise = np.quantile(spread[skin], CLEAN_QUANTILE) if skin.any() else 0.0
    texture = np.sqrt(np.maximum(np.nan_to_num(spread) ** 2 - noise**2, 0))
    texture[left_out] = 0
    covered, clean = texture > limit, skin & (texture < SOLID_SHARE * limit)
    off = np.zeros(len(faces))
    if clean.any():
        hair = scalp & (texture > limit)
        if hair.any():
            covered &= _shows_strands(colours, first, faces, len(vertices), *(colour[f] for f in (clean, hair)))
        off = np.nan_to_num(np.abs(colour - np.median(colour[clean], axis=0)).mean(axis=1))
        # Black hair shows no strands in small images: a scalp most of which does not look like skin has hair.
        seen = scalp & np.isfinite(spread)
        solid = seen & (np.median(off[seen]) > COLOUR_LIMIT) if seen.any() else seen
        covered |= ((texture > SOLID_SHARE * limit) | solid) & (off > COLOUR_LIMIT)
    covered &= ~(left_out | features)
    covered = _without_specks(covered, vertices, faces)
    labels = [(view.visibility.face, view.covering) for view in views if view.covering is not None]
    covered |= labelled_as_covered(labels, len(faces)) & ~left_out
    hidden = covered & (off > HIDDEN_COLOUR)
    unseen = np.isnan(spread) & ~(left_out | features)
    for state in (covered, hidden):
        state[unseen] = _as_around(state, ~unseen & ~left_out, faces, len(vertices))[unseen]
    return Covering(texture, colour, covered, hidden, clean & (off < HIDDEN_COLOUR))


def _shows_strands(
    colours: np.ndarray,
    first: Int[np.ndarray, " f"],
    faces: Int[np.ndarray, "f 3"],
    v: int,
    skin: Float[np.ndarray, "n 3"],
    hair: Float[np.ndarray, "m 3"],
) -> Bool[np.ndarray, " f"]:
    """Whether some pixels of each triangle are nearer to the colour of hair than to that of skin.

    Ears and nostrils that the tracking misplaces by a millimetre have the texture of strands, and not their colour. All
    triangles count where hair has the colour of skin.
    """
    skin, hair = np.median(skin, axis=0), np.nanmedian(hair, axis=0)
    channel = int(np.abs(hair - skin).argmax())
    contrast = hair[channel] - skin[channel]
    if abs(contrast) < LEAST_CONTRAST:
        return np.ones(len(faces), bool)
    pooled = _pooled(_by_face(colours[:, channel], first), faces, v)
    nearest = surface_cells.quantiles(pooled, STRANDS if contrast < 0 else 1 - STRANDS)
    return (nearest - skin[channel]) / contrast > 0.5


def _as_around(
    state: Bool[np.ndarray, " f"], known: Bool[np.ndarray, " f"], faces: Int[np.ndarray, "f 3"], v: int
) -> Bool[np.ndarray, " f"]:
    """Spread the state of known triangles to the others, ring by ring: that of most neighbours.

    Folds below hair, such as those of an ear, are seen by no view; they are covered as what is around them.
    """
    result, known = state & known, known.copy()
    while True:
        count = np.bincount(faces[known].ravel(), minlength=v)
        total = np.bincount(faces[known & result].ravel(), minlength=v)
        around, votes = count[faces].sum(axis=1), total[faces].sum(axis=1)
        new = ~known & (around > 0)
        if not new.any():
            return result
        result[new] = votes[new] > 0.5 * around[new]
        known |= new


def _without_specks(
    covered: Bool[np.ndarray, " f"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, " f"]:
    """Leave out connected parts of less than `SPECK`: edges of nostrils and folds, which the tracking misses."""
    found = np.flatnonzero(covered)
    part = _components(faces[found], len(vertices))
    corners = vertices[faces[found]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.bincount(part, 0.5 * np.linalg.norm(normals, axis=1))
    result = covered.copy()
    result[found[area[part] < SPECK]] = False
    return result


def _divide(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> tuple[np.ndarray, np.ndarray, int]:
    """First cell of each face, divisions of its edges, and the number of all cells."""
    corners = vertices[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(longest / CELL_SIZE), 1, 16).astype(np.int32)
    first = np.concatenate([[0], np.cumsum(parts.astype(np.int64) ** 2)])
    return first[:-1].astype(np.int32), parts, int(first[-1])


def _components(faces: Int[np.ndarray, "f 3"], v: int) -> Int[np.ndarray, " f"]:
    edges = coo_array((np.ones(2 * len(faces)), (faces[:, :2].ravel("F"), faces[:, 1:].ravel("F"))), shape=(v, v))
    return connected_components(edges, directed=False)[1][faces[:, 0]].astype(np.int32)


def _cells(view: HairView, usable: Bool[np.ndarray, " f"], component, first, parts) -> Int[np.ndarray, "h w"]:
    seen = view.visibility
    facing = surface_cells.facing_faces(seen.camera_points, seen.faces, MIN_COSINE)
    return surface_cells.cell_image(
        seen.face, seen.fragments.barycentric, seen.inverse_depth, seen.depth_planes,
        np.where(view.between_lips, np.float32(0), view.foreground),
        usable & facing, component, first, parts, OPAQUE, DEPTH_JUMP,
    )  # fmt: skip


def _face_medians(colours, first, faces, v) -> Float[np.ndarray, "f 3"]:
    """Median colour of each triangle and those that share a corner with it."""
    of_face = _by_face(colours.reshape(len(colours), -1), first)
    medians = [surface_cells.quantiles(_pooled(part, faces, v), 0.5) for part in np.split(of_face, 3, axis=1)]
    return np.stack(medians, axis=1)


def _by_face(of_cells: np.ndarray, first: Int[np.ndarray, " f"]) -> np.ndarray:
    """Sums over the cells of each triangle, which follow each other."""
    count = len(of_cells)
    return csr_array((np.ones(count, np.uint32), np.arange(count), np.append(first, count))) @ of_cells


def _pooled(histograms: np.ndarray, faces: Int[np.ndarray, "f 3"], v: int) -> np.ndarray:
    """Histogram of each triangle plus those that share a corner, once for each corner."""
    ones = np.ones(faces.size, np.uint32)
    corner_of_vertex = csr_array((ones, (faces.ravel(), np.repeat(np.arange(len(faces)), 3))), shape=(v, len(faces)))
    of_vertex = corner_of_vertex @ histograms
    return sum(of_vertex[corner] for corner in faces.T)
