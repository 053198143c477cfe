"""Small components (eyeballs, teeth) that move by a similarity transform of the surface around them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

CONTACT_DISTANCE = 0.1
"""Distance up to which surfaces touch, in radii of the small component."""
MIN_SURROUNDING = 12
"""Smallest number of surrounding vertices; if fewer touch, the nearest ones are taken."""


class RigidComponent(NamedTuple):
    """Small components that move together, and the vertices that determine how."""

    vertices: Int[np.ndarray, " i"]
    """Indices of their vertices."""
    surrounding: Int[np.ndarray, " a"]
    """Indices of the vertices of the main component around them."""


def umeyama(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Least-squares similarity transform between two point sets (Umeyama 1991).

    Minimises the sum of |scale * rotation @ source + translation - target|^2.

    Args:
        source: Points, in any unit.
        target: Corresponding points, in the same unit.

    Returns:
        Scale, rotation and translation.
    """
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    covariance = (target - mean_target).T @ (source - mean_source)
    u, s, vt = np.linalg.svd(covariance)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((s * signs).sum() / ((source - mean_source) ** 2).sum())
    return scale, rotation, mean_target - scale * rotation @ mean_source


def find_rigid_components(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    component_labels: Int[np.ndarray, " v"],
    main: int,
) -> list[RigidComponent]:
    """Group the components other than the main one, and find the vertices around each group.

    Components with overlapping bounding spheres, such as iris and sclera of one eye, form one group. It follows the
    skin that touches it: an eyeball follows its lids and socket and so stays between them.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.
        component_labels: Label of the component of each vertex.
        main: Label of the main component.

    Returns:
        The groups.
    """
    main_vertices, rigid_components = np.flatnonzero(component_labels == main), []
    for group in _overlapping_components(vertices, component_labels, main):
        inside = np.isin(component_labels, group)
        centre, radius = _bounding_sphere(vertices[inside])
        near = main_vertices[np.linalg.norm(vertices[main_vertices] - centre, axis=1) < (1 + CONTACT_DISTANCE) * radius]
        if len(near):
            surface = faces[inside[faces].all(axis=1)]
            squared = igl.point_mesh_squared_distance(vertices[near] - centre, vertices - centre, surface)[0]
            near = near[squared < (CONTACT_DISTANCE * radius) ** 2]
        if len(near) < MIN_SURROUNDING:
            count = min(MIN_SURROUNDING, len(main_vertices))
            near = main_vertices[cKDTree(vertices[main_vertices]).query(centre, k=count)[1]]
        rigid_components.append(RigidComponent(np.flatnonzero(inside), near))
    return rigid_components


def move_rigid_components(
    vertices: Float[np.ndarray, "v 3"],
    displacement: Float[np.ndarray, "v 3"],
    rigid_components: Sequence[RigidComponent],
) -> tuple[Float[np.ndarray, "v 3"], list[float]]:
    """Move each rigid component by the similarity transform of the vertices around it.

    Args:
        vertices: Positions, in any unit.
        displacement: Displacement of the main component, in the same unit.
        rigid_components: Components to move.

    Returns:
        Displacement of all vertices, and the scale of each component.
    """
    moved, scales, vertices = displacement.copy(), [], vertices - vertices[0]
    for members, surrounding in rigid_components:
        if displacement[surrounding].any():
            scale, rotation, translation = umeyama(
                vertices[surrounding], vertices[surrounding] + displacement[surrounding]
            )
            moved[members] = scale * vertices[members] @ rotation.T + translation - vertices[members]
            scales.append(scale)
        else:  # exactly, not up to rounding
            moved[members] = 0.0
            scales.append(1.0)
    return moved, scales


def _bounding_sphere(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "3"], float]:
    """Mean of the points, and the largest distance from it."""
    centre = points.mean(axis=0)
    return centre, np.linalg.norm(points - centre, axis=1).max()


def _overlapping_components(
    vertices: Float[np.ndarray, "v 3"], component_labels: Int[np.ndarray, " v"], main: int
) -> list[Int[np.ndarray, " _"]]:
    """Groups of labels of small components: together if the larger sphere holds the centre of the other one."""
    labels = np.setdiff1d(component_labels, [main])
    if len(labels) == 0:
        return []
    centres, radii = zip(*(_bounding_sphere(vertices[component_labels == c]) for c in labels), strict=True)
    group = connected_components(cdist(centres, centres) < np.maximum.outer(radii, radii))[1]
    return [labels[group == g] for g in range(group.max() + 1)]
