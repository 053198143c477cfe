"""Remeshing keeps a closed manifold, follows the sizing field, and leaves borders in their planes."""

from __future__ import annotations

import numpy as np
import trimesh

from carigs.toy.shape.remeshing import remesh


def edge_lengths(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2).ravel()


def test_a_sphere_gets_the_edge_lengths_of_the_sizing_field() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=50.0)

    def project(points: np.ndarray, _: np.ndarray) -> None:
        points *= 50.0 / np.linalg.norm(points, axis=1, keepdims=True)

    def size(points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 2] > 0, 6.0, 12.0)

    vertices, faces, border = remesh(
        np.asarray(ball.vertices), np.asarray(ball.faces), np.zeros(len(ball.vertices), int), size, project, 6
    )
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2 and not border.any()
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 50.0, atol=1e-9)
    fine = (vertices[faces][:, :, 2] > 12).all(axis=1)
    coarse = (vertices[faces][:, :, 2] < -12).all(axis=1)
    assert 4.5 < np.median(edge_lengths(vertices, faces[fine])) < 7.5
    assert 9.0 < np.median(edge_lengths(vertices, faces[coarse])) < 15.0


def test_border_vertices_stay_on_their_lines_and_no_inner_edge_joins_them() -> None:
    x, y = np.meshgrid(np.linspace(0, 40, 9), np.linspace(0, 40, 9), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    ids = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    border = (vertices[:, 0] == 0) + 2 * (vertices[:, 1] == 0)
    # Vertices of the two open sides are not marked: only the marked ones are checked.
    vertices, faces, border = remesh(
        vertices, faces, border, lambda p: np.full(len(p), 3.0), lambda p, border: None, rounds=3
    )
    assert (vertices[(border & 1) > 0, 0] == 0).all() and (vertices[(border & 2) > 0, 1] == 0).all()
    assert (border == 3).sum() == 1 and len(faces) > 128
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    assert not (border[edges[count == 2, 0]] & border[edges[count == 2, 1]]).any()
