"""The template mesh: the sculpture's surface, meshed and mirrored, and two eyeballs."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.toy.shape import sculpture
from carigs.toy.shape.field import EYE_RADIUS, EYE_X, EYE_Y, EYE_Z, close_mouth, project, sample
from carigs.toy.shape.marching import surface
from carigs.toy.shape.remesh import remesh
from carigs.toy.shape.sizing import edge_lengths

NECK_CUT = -168.0  # y of the open end of the neck
_HIGH = np.array([104.0, 150.0, 126.0])
_STEP = 1.5  # the lids are 2.4 thick
_LOW = np.array([0.0, NECK_CUT, -114.0])


class Template(NamedTuple):
    """Skin first, then the left (x > 0) and the right eyeball; millimetres."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    mirror: Int[np.ndarray, "v"]
    """The vertex at (-x, y, z) of each vertex."""
    left_eye: Bool[np.ndarray, "v"]
    right_eye: Bool[np.ndarray, "v"]

    @property
    def skin(self) -> Bool[np.ndarray, "v"]:
        """Vertices that belong to neither eyeball."""
        return ~(self.left_eye | self.right_eye)


@lru_cache(maxsize=1)
def template() -> Template:
    """Build it (about two seconds); the same for every person."""
    rows = sculpture.solids()
    shape = tuple(int(n) for n in np.ceil((_HIGH - _LOW) / _STEP) + 1)
    vertices, faces = surface(sample(rows, _LOW, _STEP, shape), _LOW, _STEP)
    tag = (vertices[:, 0] < 1e-9) + 2 * (vertices[:, 1] < NECK_CUT + 1e-9)
    vertices, faces, tag = remesh(
        vertices, faces, tag, edge_lengths, lambda points, tag: project(points, tag, rows), rounds=7
    )
    middle = (tag & 1) > 0
    vertices[middle, 0] = 0.0
    close_mouth(vertices)
    n, m = len(vertices), np.count_nonzero(~middle)
    mirrored = np.arange(n)
    mirrored[~middle] = n + np.arange(m)
    ball, ball_faces = eyeball()
    b, skin = len(ball), n + m
    ball += np.array([EYE_X, EYE_Y, EYE_Z])
    flip = np.array([-1.0, 1.0, 1.0])
    left = skin + np.arange(b)
    vertex_ids = np.arange(skin + 2 * b)
    return Template(
        vertices=np.concatenate([vertices, vertices[~middle] * flip, ball, ball * flip]),
        faces=np.concatenate(
            [faces, mirrored[faces][:, ::-1], ball_faces + skin, ball_faces[:, ::-1] + skin + b], dtype=np.int32
        ),
        mirror=np.concatenate([mirrored, np.flatnonzero(~middle), left + b, left]),
        left_eye=(vertex_ids >= skin) & (vertex_ids < skin + b),
        right_eye=vertex_ids >= skin + b,
    )


def eyeball() -> tuple[Float[np.ndarray, "b 3"], Int[np.ndarray, "g 3"]]:
    """A closed ball about the origin with its pole at +z, finer in front."""
    polar = np.radians([9.0, 18.0, 28.0, 39.0, 51.0, 65.0, 82.0, 104.0, 133.0])
    around = 16
    angle = np.arange(around) * 2 * np.pi / around
    rings = [
        np.stack([np.sin(p) * np.cos(angle), np.sin(p) * np.sin(angle), np.full(around, np.cos(p))], axis=1)
        for p in polar
    ]
    vertices = EYE_RADIUS * np.concatenate([[[0.0, 0.0, 1.0]], *rings, [[0.0, 0.0, -1.0]]])
    ring = 1 + np.arange(len(polar) * around).reshape(-1, around)
    here, there = ring, np.roll(ring, -1, axis=1)
    last = len(vertices) - 1
    a, b, c, d = here[:-1], there[:-1], there[1:], here[1:]
    faces = np.concatenate(
        [
            np.stack([np.zeros(around, int), here[0], there[0]], axis=1),
            np.stack([a, d, b], axis=-1).reshape(-1, 3),
            np.stack([b, d, c], axis=-1).reshape(-1, 3),
            np.stack([there[-1], here[-1], np.full(around, last)], axis=1),
        ]
    )
    return vertices, faces
