"""Surfaces that a program wrote twice, once with each orientation, so that they are seen from both sides.

Both sides have the same corners, as vertices of their own or as the same ones. As a surface they enclose nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.mesh.triangle_mesh import components, signed_volume
from carigs.readers.mesh_files.coincident import equal_rows, places


class OneSided(NamedTuple):
    """One side of a mesh."""

    faces: Int[np.ndarray, "f 3"]
    """In the order of the input."""
    twin: Int[np.ndarray, " v"]
    """Of each vertex the one at its place on the side that is kept; itself if it has none."""


def one_sided(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "g 3"]) -> OneSided:
    """Remove the inner one of two sides.

    A face goes if another one has the same corners in reverse order, and if the same is true of all faces
    that it is connected with: where two solids touch, both keep their faces.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices, three different ones in each face.

    Returns:
        The rest of the faces. Of two sides that are alike the first stays, or the second if the first faces inwards.
    """
    twin, place = np.arange(len(vertices)), places(vertices)[faces]
    first, second = _reversed_pairs(place)
    is_paired = np.zeros(len(faces), bool)
    is_paired[first] = is_paired[second] = True
    is_whole = _all_in_component(is_paired, faces, len(vertices))
    removable = is_whole[first] | is_whole[second]
    first, second = first[removable], second[removable]
    if len(first) == 0:
        return OneSided(faces, twin)
    either = is_whole[first] & is_whole[second]
    centred = vertices - vertices[faces[first]].mean(axis=(0, 1))
    turned = either & (either.any() and signed_volume(centred, faces[first[either]]) < 0)
    swap = turned | ~is_whole[second]  # else the second one goes
    kept, removed = np.where(swap, second, first), np.where(swap, first, second)
    by_place = [np.take_along_axis(faces[side], place[side].argsort(axis=1), axis=1) for side in (removed, kept)]
    twin[by_place[0]] = by_place[1]
    return OneSided(np.delete(faces, removed, axis=0), twin)


def _reversed_pairs(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Faces of which exactly two have the same corners, in reverse order: the earlier ones, and the later ones."""
    group = equal_rows(np.sort(faces, axis=1))
    sizes = np.bincount(group)
    by_group = np.argsort(group, kind="stable")
    earlier, later = (by_group[sizes[group[by_group]] == 2].reshape(-1, 2)).T
    # Corners in cyclic order from the smallest: the second one tells the orientation.
    rows = np.arange(len(faces))
    following = faces[rows, (faces.argmin(axis=1) + 1) % 3]
    is_reverse = following[earlier] != following[later]
    return earlier[is_reverse], later[is_reverse]


def _all_in_component(
    values: Bool[np.ndarray, " f"], faces: Int[np.ndarray, "f 3"], num_vertices: int
) -> Bool[np.ndarray, " f"]:
    """Whether a value holds for all faces that are connected with a face."""
    label = components(faces, num_vertices)[faces[:, 0]]
    return np.bincount(label, ~values)[label] == 0
