"""Meshes that hold every triangle twice, once from each side, mean the surface that they hold once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from carigs.mesh.repair import clean_mesh
from carigs.mesh.triangle_mesh import signed_volume
from carigs.readers.mesh_files.meshes import read_mesh

_sphere = trimesh.creation.icosphere(2)
VERTICES = np.asarray(_sphere.vertices) * [0.1, 0.13, 0.11] + [0, 1.6, 0.2]
CLOSED = np.asarray(_sphere.faces)
OPEN = CLOSED[VERTICES[CLOSED].mean(axis=1)[:, 1] > 1.5]
OWN = np.concatenate([VERTICES, VERTICES])


def interleaved(faces):
    return np.stack([faces, faces[:, ::-1]], axis=1).reshape(-1, 3)


def soup(faces):
    return VERTICES[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


WAYS = {
    "the same vertices": lambda f: (VERTICES, np.concatenate([f, f[:, ::-1]])),
    "the back first": lambda f: (VERTICES, np.concatenate([f[:, ::-1], f])),
    "side by side": lambda f: (VERTICES, interleaved(f)),
    "own vertices": lambda f: (OWN, np.concatenate([f, f[:, ::-1] + len(VERTICES)])),
    "own vertices, the back first": lambda f: (OWN, np.concatenate([f[:, ::-1], f + len(VERTICES)])),
    "in another order": lambda f: (OWN, np.concatenate([f, f[::-1, [1, 0, 2]] + len(VERTICES)])),
    "triangles without neighbours": lambda f: soup(interleaved(f)),
    "half of it": lambda f: (OWN, np.concatenate([f, f[: len(f) // 2, ::-1] + len(VERTICES)])),
}


@pytest.mark.parametrize("faces", [OPEN, CLOSED], ids=["open", "closed"])
@pytest.mark.parametrize("way", WAYS)
def test_two_sides_are_the_outer_one(way, faces):
    vertices, both = WAYS[way](faces)
    once, clean = clean_mesh(VERTICES, faces), clean_mesh(vertices, both)
    assert clean.report.duplicate_faces == len(both) - len(faces)

    def triangles(mesh):
        corners = mesh.vertices[mesh.faces]
        start = np.lexsort(np.moveaxis(corners, 2, 0)[::-1], axis=1)[:, 0]
        turned = corners[np.arange(len(corners))[:, None], (start[:, None] + np.arange(3)) % 3]
        return {tuple(row) for row in turned.reshape(-1, 9).tolist()}

    assert triangles(clean) == triangles(once)  # with their orientation
    centre = clean.vertices.mean(axis=0)
    assert signed_volume(clean.vertices - centre, clean.faces) > 0
    used = np.unique(both)
    moved = clean.to_input(clean.vertices)[used]  # vertices of both sides move with the surface
    np.testing.assert_array_equal(moved, vertices[used])


def test_solids_that_touch_keep_the_faces_between_them():
    box = trimesh.creation.box((1, 1, 1))
    faces = np.asarray(box.faces)
    turned = faces.copy()
    corner = np.asarray(box.vertices)
    vertices = np.concatenate([corner, corner * [1, 1, -1] + [0, 0, 1]])  # mirrored, so that diagonals agree
    both = np.concatenate([faces, turned[:, ::-1] + len(corner)])
    clean = clean_mesh(vertices, both)
    assert clean.report.duplicate_faces == 0 and clean.report.components == 2
    assert signed_volume(clean.vertices, clean.faces) == pytest.approx(2)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("own", [False, True])
def test_polygons_of_both_sides_are_cut_alike(tmp_path: Path, own, first):
    """From another first corner, or in reverse, a fan would have the other diagonal."""
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4]]
    corner = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1.3) for z in (0, 0.9)]
    back = [[*reversed(quad[first:] + quad[:first])] for quad in quads]
    lines = [*corner, *(corner if own else [])]
    lines += [f"f {' '.join(str(i + 1) for i in quad)}" for quad in quads]
    lines += [f"f {' '.join(str(i + 1 + 8 * own) for i in quad)}" for quad in back]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "b.obj").write_text("\n".join([*corner, *lines[8 * (1 + own) :][:5]]))
    two, one = read_mesh(tmp_path / "a.obj"), read_mesh(tmp_path / "b.obj")
    clean, once = clean_mesh(two.vertices, two.faces), clean_mesh(one.vertices, one.faces)
    assert clean.report.duplicate_faces == 10 == len(clean.faces)
    centres = [np.sort(mesh.vertices[mesh.faces].mean(axis=1), axis=0) for mesh in (clean, once)]
    np.testing.assert_array_equal(*centres)
