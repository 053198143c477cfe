"""Small components (eyeballs, teeth) that follow the surface around them by a similarity instead of bursting."""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

TOUCH = 0.1
"""What is nearer to a group's surface than this, in its radii, touches it."""
LEAST = 12
"""So many vertices at least are followed: the nearest."""


def similarity(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Scale, rotation and translation of the least-squares map source -> target (Umeyama 1991)."""
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    covariance = (target - mean_target).T @ (source - mean_source)
    u, s, vt = np.linalg.svd(covariance)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((s * signs).sum() / ((source - mean_source) ** 2).sum())
    return scale, rotation, mean_target - scale * rotation @ mean_source


class RigidComponent(NamedTuple):
    """Small components that move as one, and what they follow."""

    inside: Int[np.ndarray, " i"]
    """Their vertices."""
    around: Int[np.ndarray, " a"]
    """The vertices of the main component around them."""


def find_rigid_components(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], component: Int[np.ndarray, " v"], main: int
) -> list[RigidComponent]:
    """All components but `main`; those whose bounding spheres overlap (iris and sclera of one eye) are one group.

    A group follows the skin that touches it: an eyeball its lids and socket, so that it stays between them.
    """
    on_main, found = np.flatnonzero(component == main), []
    for group in _groups(vertices, component, main):
        inside = np.isin(component, group)
        centre = vertices[inside].mean(axis=0)
        radius = np.linalg.norm(vertices[inside] - centre, axis=1).max()
        near = on_main[np.linalg.norm(vertices[on_main] - centre, axis=1) < (1 + TOUCH) * radius]
        around = near
        if len(near):
            surface = faces[inside[faces].all(axis=1)]
            squared = igl.point_mesh_squared_distance(vertices[near] - centre, vertices - centre, surface)[0]
            around = near[squared < (TOUCH * radius) ** 2]
        if len(around) < LEAST:
            around = on_main[cKDTree(vertices[on_main]).query(centre, k=min(LEAST, len(on_main)))[1]]
        found.append(RigidComponent(np.flatnonzero(inside), around))
    return found


def follow(
    vertices: Float[np.ndarray, "v 3"], displacement: Float[np.ndarray, "v 3"], followers: list[RigidComponent]
) -> tuple[Float[np.ndarray, "v 3"], list[float]]:
    """Move each follower by the similarity of what is around it; returns all displacements and the scale of each."""
    moved, scales, vertices = displacement.copy(), [], vertices - vertices[0]
    for inside, around in followers:
        if displacement[around].any():
            scale, rotation, shift = similarity(vertices[around], vertices[around] + displacement[around])
            moved[inside] = scale * vertices[inside] @ rotation.T + shift - vertices[inside]
            scales.append(scale)
        else:  # bit for bit
            moved[inside] = 0.0
            scales.append(1.0)
    return moved, scales


def _groups(vertices: np.ndarray, component: np.ndarray, main: int) -> list[list[int]]:
    labels = [c for c in np.unique(component) if c != main]
    spheres = []
    for c in labels:
        points = vertices[component == c]
        centre = points.mean(axis=0)
        spheres.append((centre, np.linalg.norm(points - centre, axis=1).max()))
    groups: list[list[int]] = []
    for k, (centre, radius) in enumerate(spheres):
        touching = [
            group
            for group in groups
            if any(np.linalg.norm(centre - spheres[i][0]) < max(radius, spheres[i][1]) for i in group)
        ]
        groups = [group for group in groups if group not in touching] + [[k, *(i for group in touching for i in group)]]
    return [[labels[i] for i in group] for group in groups]
