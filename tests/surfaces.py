"""Analytic surfaces, a bumpy sphere, and two simple settings, for the tests of meshes and of their exaggeration."""

from __future__ import annotations

import numpy as np
import trimesh

from carigs.settings import Exaggerate

RAW = Exaggerate(
    curvature_floor=1e-9,
    curvature_smoothing=0.0,
    limit_cavities=False,
    gap_stiffness=0.0,
    normalize_weights=False,
    rigid_components=False,
)


PLAIN = Exaggerate(limit_cavities=False, gap_stiffness=0.0)


def sphere(subdivisions: int, radius: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(mesh.vertices), np.array(mesh.faces)


def cap(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """The unit sphere without its faces below z = -0.3: an open surface."""
    vertices, faces = sphere(subdivisions)
    faces = faces[vertices[faces].mean(axis=1)[:, 2] > -0.3]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def torus() -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.torus(1.0, 0.4, major_sections=40, minor_sections=20)
    return np.array(mesh.vertices), np.array(mesh.faces)


def bumpy(subdivisions: int = 3) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = sphere(subdivisions)
    return vertices * (1 + 0.2 * np.sin(4 * vertices[:, :1]) * np.cos(3 * vertices[:, 1:2])), faces
