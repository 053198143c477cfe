"""Vertices of the canonical face whose place on a head is known before the registration.

The contours of lips and lids lie on the rims of the head's openings, equally far on the way from one corner to the
other. Landmarks that the head model has itself tell where brows, nose and the outside of the lips are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from carigs.embedding.canonical_face import CONTOURS, IBUG_INNER, NOSE_TIP, canonical_face
from carigs.embedding.outer_skin import OuterSkin
from carigs.errors import MeshError

RIM_WEIGHT, LANDMARK_WEIGHT = 3.0, 2.0
"""In weights of a closest point. Landmarks of coarse heads are vertices: they are off by the length of an edge."""
NAMES = {"left_eye": "the left eye", "right_eye": "the right eye", "mouth": "the mouth"}


class Anchors(NamedTuple):
    """Vertices of a mesh with places."""

    vertices: Int[np.ndarray, " a"]
    places: Float[np.ndarray, "a 3"]
    weights: Float[np.ndarray, " a"]


def find_anchors(skin: OuterSkin, landmarks68: Float[np.ndarray, "68 3"] | None) -> Anchors:
    """Find the anchors of the canonical face.

    Args:
        skin: Outer skin of the head.
        landmarks68: The 68 landmarks of iBUG on the head, in the unit of the skin; None if they are not known.

    Returns:
        The anchors, in the unit of the skin.

    Raises:
        MeshError: If the head has no landmarks, and its mouth or an eye is closed.
    """
    found: dict[int, tuple[np.ndarray, float]] = {}
    if landmarks68 is not None:
        found |= {i: (place, LANDMARK_WEIGHT) for i, place in zip(IBUG_INNER, landmarks68[17:], strict=True)}
    elif closed := [name for name in CONTOURS if name not in skin.rims]:
        raise MeshError(
            f"no rim of {' and of '.join(NAMES[name] for name in closed)} is seen from the front: a head without "
            "landmarks68 looks to +z, has open eyes, and lips that are not joined"
        )
    for name, rim in skin.rims.items():
        for chain, arc in zip((CONTOURS[name].upper, CONTOURS[name].lower), _arcs(rim), strict=True):
            places = _at_shares(arc, _shares(canonical_face().vertices[list(chain)]))
            found |= {i: (place, RIM_WEIGHT) for i, place in zip(chain, places, strict=True)}
    places, weights = zip(*found.values(), strict=True)
    return Anchors(np.array(list(found)), np.array(places), np.array(weights))


def similarity_start(skin: OuterSkin, anchors: Anchors) -> Float[np.ndarray, "468 3"]:
    """Move the canonical face onto its anchors and the tip of the nose by a similarity (Umeyama 1991).

    Args:
        skin: Outer skin of the head.
        anchors: The anchors, in the unit of the skin.

    Returns:
        The vertices of the canonical face, in the unit of the skin.
    """
    vertices = canonical_face().vertices
    source, target = vertices[[*anchors.vertices, NOSE_TIP]], np.vstack([anchors.places, skin.nose_tip])
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    u, spread, vt = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    signs = np.array([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    scale = (signs @ spread) / ((source - source_mean) ** 2).sum()
    return scale * (vertices - source_mean) @ (u * signs @ vt).T + target_mean


def _arcs(rim: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "a 3"], Float[np.ndarray, "b 3"]]:
    """The upper and the lower part of a rim, from its smallest to its largest x."""
    rim = np.roll(rim, -int(rim[:, 0].argmin()), axis=0)
    end = int(rim[:, 0].argmax())
    one, other = rim[: end + 1], np.vstack([rim[end:], rim[:1]])[::-1]
    return (one, other) if one[:, 1].mean() > other[:, 1].mean() else (other, one)


def _shares(chain: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """How far each point of a chain is on the way from its first to its last point, along the line through both.

    Not along the chain: rims follow the edges of triangles, and zigzags make them longer.
    """
    along = chain[-1] - chain[0]
    return np.maximum.accumulate((chain - chain[0]) @ along / (along @ along))


def _at_shares(chain: Float[np.ndarray, "n 3"], shares: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
    """Points of a chain at shares of the way."""
    return np.stack([np.interp(shares, _shares(chain), column) for column in chain.T], axis=1)
