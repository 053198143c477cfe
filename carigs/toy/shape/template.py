"""Template mesh of the procedural head: the surface of the solids, remeshed and mirrored, and two eyeballs."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.toy.shape.anatomy import EYE_CENTRE, EYE_RADIUS
from carigs.toy.shape.head_solids import head_solids
from carigs.toy.shape.marching_tetrahedra import marching_tetrahedra
from carigs.toy.shape.remeshing import remesh
from carigs.toy.shape.signed_distance import close_lips, project_to_surface, sample_head_distance
from carigs.toy.shape.sizing_field import target_edge_lengths

NECK_CUT = -168.0  # y of the open end of the neck, millimetres
_LOW, _HIGH = np.array([0.0, NECK_CUT, -114.0]), np.array([104.0, 150.0, 126.0])
_STEP = 1.5  # the lids are 2.4 mm thick
_MIRROR = np.array([-1.0, 1.0, 1.0])


class Template(NamedTuple):
    """The template mesh, in millimetres: the head surface first, then the left (x > 0) and the right eyeball."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    left_eye: Bool[np.ndarray, " v"]
    """Whether a vertex belongs to the left eyeball."""
    right_eye: Bool[np.ndarray, " v"]

    @property
    def on_head(self) -> Bool[np.ndarray, " v"]:
        """Whether a vertex belongs to the head surface, that is to neither eyeball."""
        return ~(self.left_eye | self.right_eye)


@lru_cache(maxsize=1)
def build_template() -> Template:
    """Build the template mesh, which is the same for every person (about two seconds; cached).

    Returns:
        The mesh, in millimetres.
    """
    solids = head_solids()
    shape = tuple(int(n) for n in np.ceil((_HIGH - _LOW) / _STEP) + 1)
    vertices, faces = marching_tetrahedra(sample_head_distance(solids, _LOW, _STEP, shape), _LOW, _STEP)
    border = (vertices[:, 0] < 1e-9) + 2 * (vertices[:, 1] < NECK_CUT + 1e-9)
    project = partial(project_to_surface, solids)
    vertices, faces, border = remesh(vertices, faces, border, target_edge_lengths, project, rounds=7)
    left = (border & 1) == 0  # the others lie on the midline
    vertices[~left, 0] = 0.0
    close_lips(vertices)
    mirrored = np.where(left, len(vertices) - 1 + np.cumsum(left), np.arange(len(vertices)))
    head = np.concatenate([vertices, vertices[left] * _MIRROR])
    ball, ball_faces = _eyeball()
    ball += EYE_CENTRE
    n, b = len(head), len(ball)
    faces = [faces, mirrored[faces][:, ::-1], ball_faces + n, ball_faces[:, ::-1] + n + b]
    part = np.repeat([0, 1, 2], [n, b, b])
    return Template(
        vertices=np.concatenate([head, ball, ball * _MIRROR]),
        faces=np.concatenate(faces, dtype=np.int32),
        left_eye=part == 1,
        right_eye=part == 2,
    )


def _eyeball() -> tuple[Float[np.ndarray, "b 3"], Int[np.ndarray, "g 3"]]:
    """A closed sphere around the origin with its pole at +z, finer in front."""
    polar = np.radians([9.0, 18.0, 28.0, 39.0, 51.0, 65.0, 82.0, 104.0, 133.0])
    around = 16
    p, angle = np.repeat(polar, around), np.tile(np.arange(around) * 2 * np.pi / around, len(polar))
    rings = np.stack([np.sin(p) * np.cos(angle), np.sin(p) * np.sin(angle), np.cos(p)], axis=1)
    vertices = EYE_RADIUS * np.concatenate([[[0.0, 0.0, 1.0]], rings, [[0.0, 0.0, -1.0]]])
    ring = np.pad(1 + np.arange(len(polar) * around).reshape(-1, around), ((0, 0), (0, 1)), "wrap")
    first, last = np.zeros(around, int), np.full(around, len(vertices) - 1)
    front = np.stack([first, ring[0, :-1], ring[0, 1:]], axis=1)
    back = np.stack([ring[-1, 1:], ring[-1, :-1], last], axis=1)
    return vertices, np.concatenate([front, grid_faces(ring), back])


def grid_faces(vertices: Int[np.ndarray, "r c"]) -> Int[np.ndarray, "f 3"]:
    """Triangulate a grid of vertices, two triangles to a cell.

    Args:
        vertices: Vertex indices, by row and column.

    Returns:
        Faces, counter-clockwise where rows run down and columns to the right.
    """
    a, b, c, d = vertices[:-1, :-1], vertices[:-1, 1:], vertices[1:, 1:], vertices[1:, :-1]
    return np.concatenate([np.stack([a, d, b], axis=-1).reshape(-1, 3), np.stack([b, d, c], axis=-1).reshape(-1, 3)])
