"""The canonical face of MediaPipe: the mesh whose vertices are the first 468 landmarks, in a neutral pose.

`canonical_face.npz` holds vertices and triangles of `canonical_face_model.obj` (mediapipe/modules/face_geometry/data,
Apache-2.0): centimetres, +y up, the face towards +z, the subject's left side at +x. Points of the irises are no part
of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from carigs.detection.mesh_indices import LEFT_EYE, LIPS_INNER, RIGHT_EYE
from carigs.readers.npz import read_npz

FILE = Path(__file__).with_name("canonical_face.npz")
NOSE_TIP = 4
IBUG_INNER = (
    *(70, 63, 105, 66, 107, 336, 296, 334, 293, 300),  # brows
    *(168, 197, 5, 4, 75, 97, 2, 326, 305),  # nose
    *(33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380),  # eyes
    *(61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181),  # lips, outside
    *(78, 82, 13, 312, 308, 317, 14, 87),  # lips, inside
)
"""The vertices nearest in meaning to landmarks 17 to 67 of iBUG, all but the jaw line."""


@dataclass(frozen=True)
class CanonicalFace:
    """The mesh, with holes where eyes and mouth are."""

    vertices: Float[np.ndarray, "468 3"]
    faces: Int[np.ndarray, "g 3"]
    """Triangles, without those that close eyes and mouth."""


@dataclass(frozen=True)
class Contour:
    """The vertices around an opening: chains from its end at -x to that at +x, which both have."""

    upper: tuple[int, ...]
    lower: tuple[int, ...]


def _contour(below: tuple[int, ...], above: tuple[int, ...], outer_first: int = 1) -> Contour:
    lower, upper = below, (below[0], *above, below[-1])
    return Contour(upper[::outer_first], lower[::outer_first])


CONTOURS = {
    "mouth": _contour(LIPS_INNER[:11], LIPS_INNER[11:]),
    "right_eye": _contour(LEFT_EYE[:9], LEFT_EYE[9:]),  # the subject's right eye, at the left of an image
    "left_eye": _contour(RIGHT_EYE[:9], RIGHT_EYE[9:], -1),
}
"""Lips where they meet, and the edges of the lids, by the names of `OuterSkin.rims`."""


@cache
def canonical_face() -> CanonicalFace:
    """Read the mesh (cached).

    Returns:
        The mesh, in centimetres.
    """
    arrays = read_npz(FILE, "canonical face", ("vertices", "faces"))
    faces = arrays["faces"].astype(np.int64)
    for contour in CONTOURS.values():
        faces = faces[~np.isin(faces, (*contour.upper, *contour.lower)).all(axis=1)]
    return CanonicalFace(arrays["vertices"].astype(np.float64), faces)
