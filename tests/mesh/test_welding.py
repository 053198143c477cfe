"""Seams of parts that almost touch are welded; lips, lids, eyeballs and honest borders are not."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.exaggeration import Exaggerator
from carigs.mesh import clean_mesh
from carigs.mesh.triangle_mesh import unique_edges
from carigs.settings import Exaggerate

seeds = st.integers(0, 2**32 - 1)


def head(subdivisions=3):
    """A bumpy ball, open below, of about a head's size in metres."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.1)
    x, y, z = np.asarray(ball.vertices).T
    vertices = np.asarray(ball.vertices) * (1 + 0.1 * np.sin(40 * x) + 0.1 * np.cos(30 * z))[:, None]
    faces = np.asarray(ball.faces)[y[ball.faces].mean(axis=1) > -0.07]
    used, corners = np.unique(faces, return_inverse=True)
    return vertices[used], corners.reshape(-1, 3)


VERTICES, FACES = head()


def islands(vertices, faces, random, count=6):
    """Cut a mesh into parts with vertices of their own; returns also the part and the original of each vertex."""
    centres = vertices[faces].mean(axis=1)
    seed = centres[random.choice(len(centres), count, replace=False)]
    part = np.linalg.norm(centres[:, None] - seed, axis=2).argmin(axis=1)
    pairs, corners = np.unique(np.stack([np.repeat(part, 3), faces.ravel()], axis=1), axis=0, return_inverse=True)
    return vertices[pairs[:, 1]], corners.reshape(-1, 3), *pairs.T


def rounded_by_part(vertices, part, step, random):
    """Round to multiples of a step, in a frame of reference that each part has for itself, as objects of a scene."""
    shift = random.uniform(-step, step, (part.max() + 1, 3))[part]
    return np.round((vertices + shift) / step) * step - shift


def border_length(faces):
    return int((unique_edges(faces)[1] == 1).sum())


def grid(columns=12, rows=6):
    """A flat sheet of unit squares."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel(), corner[1:, 1:].ravel(), corner[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces


def mouth(gap, columns=12, rows=6):
    """A sheet with a slit between two corners in its middle: closed lips whose middles are `gap` edges apart."""
    vertices, faces = grid(columns, rows)
    middle = np.flatnonzero((vertices[:, 1] == rows / 2) & (np.abs(vertices[:, 0] - columns / 2) < columns / 2 - 2))
    below = vertices[faces].mean(axis=1)[:, 1] < rows / 2
    twin = np.arange(len(vertices))
    twin[middle] = len(vertices) + np.arange(len(middle))
    open_by = gap * np.cos(np.pi * (vertices[middle, 0] / columns - 0.5))[:, None]
    return np.concatenate([vertices, vertices[middle] - open_by * [0, 1, 0]]), np.where(
        below[:, None], twin[faces], faces
    )


@settings(max_examples=8, deadline=None)
@given(seeds, st.sampled_from([1.0, 1e2, 1e3]))
def test_parts_rounded_on_their_own_give_the_mesh_again(seed, units_per_metre):
    """Rounded to a millionth of the file's unit: metres, centimetres or millimetres."""
    random = np.random.default_rng(seed)
    vertices, faces, part, original = islands(units_per_metre * VERTICES, FACES, random)
    step = 1e-6
    clean = clean_mesh(rounded_by_part(vertices, part, step, random), faces)
    assert clean.faces.shape == FACES.shape and clean.vertices.shape == VERTICES.shape
    assert clean.report.components == clean.report.boundary_loops == 1
    assert clean.report.welded_vertices == len(vertices) - len(VERTICES)
    assert 0 < clean.report.widest_weld <= 2 * np.sqrt(3) * step
    assert f"{clean.report.widest_weld:.2g} apart" in str(clean.report)
    pairs = np.unique(np.stack([original, clean.vertex_map], axis=1), axis=0)
    assert len(pairs) == len(VERTICES)  # all copies of a vertex became one, and no others
    np.testing.assert_array_equal(pairs[FACES, 1], clean.vertex_map[faces])


@pytest.mark.parametrize("step", [1e-7, 1e-6, 1e-5])
def test_the_caricature_of_rounded_parts_is_that_of_the_rounded_mesh(step):
    """What is left is the rounding itself, which curvature amplifies, in the intact mesh as in its parts."""
    random = np.random.default_rng(1)

    def caricature(vertices, faces):
        clean = clean_mesh(vertices, faces)
        return clean.to_input(Exaggerator(clean.vertices, clean.faces, Exaggerate()).solve(0.25))

    exact = caricature(VERTICES, FACES)
    vertices, faces, part, original = islands(VERTICES, FACES, random)
    of_parts = caricature(rounded_by_part(vertices, part, step, random), faces)
    whole = [caricature(rounded_by_part(VERTICES, np.arange(len(VERTICES)), step, random), FACES) for _ in range(3)]
    rounding = max(np.linalg.norm(moved - exact, axis=1).max() for moved in whole)
    assert np.linalg.norm(of_parts - exact[original], axis=1).max() < 3 * rounding + 1e-12
    assert np.linalg.norm(exact, axis=1).max() > 100 * rounding


@pytest.mark.parametrize("gap", [0.005, 0.02, 0.09])
def test_closed_lips_stay_apart(gap):
    vertices, faces = mouth(gap)
    clean = clean_mesh(vertices, faces)
    assert clean.report.welded_vertices == 0
    assert clean.report.boundary_loops == 2


@pytest.mark.parametrize("gap", [0.0, 1e-5, 1e-3])
def test_a_slit_that_only_rounding_opens_is_closed(gap):
    clean = clean_mesh(*mouth(gap))
    assert (clean.report.welded_vertices, clean.report.boundary_loops) == (7, 1)


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-5, 0.01])
def test_closed_lips_with_corners_inside_are_no_error(gap):
    """Welding the lips at (1, 0, 0) would lay the two triangles of the corner h upon each other: three at an edge."""
    w, h, a, b, t, s, other = range(7)
    vertices = np.array([[0, 0, 0], [0.5, 0, -0.5], [1, 0, 0], [2, 0, 0], [1, 1, 0], [1, -1, 0], [1, -gap, 0]], float)
    upper, lower = [[w, a, t], [a, b, t], [w, h, a]], [[w, s, other], [other, s, b], [w, other, h]]
    clean = clean_mesh(vertices, np.array(upper + lower))
    assert clean.report.welded_vertices == 0 and clean.report.components == 1
    assert border_length(clean.faces) == 8


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-5, 1e-3, 0.02])
@pytest.mark.parametrize("split", [[3], [3, 5], range(2, 8), [2, 9], range(2, 10)])
def test_closed_lips_with_other_vertices_stay_apart(gap, split):
    """Some edges of the lower lip are split: at the others, the lips have the same vertices."""
    vertices, faces = mouth(gap)
    lower = {tuple(v[:2]): i for i, v in enumerate(vertices[:91])}
    twin = {i: len(vertices) - 7 + k for k, i in enumerate(lower[x, 3.0] for x in range(3, 10))}
    for x in split:
        first, second = (lower[x + k, 3.0] for k in (0.0, 1.0))
        ends = {twin.get(first, first), twin.get(second, second)}
        inside = vertices[faces].mean(axis=1)[:, 1] < 3
        face = next(f for f in np.flatnonzero(inside) if ends <= {*faces[f]})
        (top,) = {*faces[face]} - ends
        k = [*faces[face]].index(top)
        _, a, b = np.roll(faces[face], -k)
        new, vertices = len(vertices), np.concatenate([vertices, vertices[[a, b]].mean(axis=0)[None]])
        faces = np.concatenate([np.delete(faces, face, axis=0), [[top, a, new], [top, new, b]]])
    clean = clean_mesh(vertices, faces)
    assert clean.report.welded_vertices == 0
    assert clean.report.boundary_loops == 2


@pytest.mark.parametrize("angle", [0.02, 0.1, 0.3])
def test_the_tip_of_a_part_is_no_slit(angle):
    """A part with a narrow tip, whose two sides lie along each other there, is welded with its neighbours."""
    upper = np.array([[0, 0, 0], [4, 0, 0], [4, 2, 0], [0, 2, 0]], float)
    tip = np.array([[0, 0, 0], [4, 0, 0], [4, -4 * np.tan(angle), 0]])
    lower = np.array([[0, 0, 0], [4, -4 * np.tan(angle), 0], [4, -4, 0], [0, -4, 0]])
    parts = [upper, tip - np.array([0, 1e-4, 0]), lower - np.array([0, 2e-4, 0])]
    faces = [[0, 1, 2], [0, 2, 3], [5, 4, 6], [7, 10, 9], [7, 9, 8]]
    assert clean_mesh(np.concatenate(parts), np.array(faces)).report.components == 1


def test_lips_that_roll_inwards_stay_apart():
    """Two parts whose borders coincide edge by edge, but whose faces lie upon each other."""
    upper, faces = grid(8, 3)
    lower = upper * [1, 1, 0] - np.array([0, 0, 1]) * (0.01 + 0.2 * upper[:, 1:2])
    clean = clean_mesh(np.concatenate([upper, lower]), np.concatenate([faces, faces[:, ::-1] + len(upper)]))
    assert clean.report.welded_vertices == 0
    assert clean.report.components == 2


@pytest.mark.parametrize("distance", [0.0, 1e-4, 0.01])
def test_an_eyeball_that_touches_its_socket_stays_apart(distance):
    """The ball is closed and fills a hole of the sheet: it has no border that could be a side of a seam."""
    vertices, faces = grid(12, 12)
    hole = np.linalg.norm(vertices[faces].mean(axis=1) - [6, 6, 0], axis=1) < 2.5
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2.5 + distance)
    both = np.concatenate([vertices, ball.vertices + np.array([6, 6, -0.5])])
    clean = clean_mesh(both, np.concatenate([faces[~hole], np.asarray(ball.faces) + len(vertices)]))
    assert clean.report.components == 2
    assert clean.report.welded_vertices == 0


def test_a_border_with_other_vertices_stays_open():
    """Two sheets side by side, of 12 and of 5 edges: what coincides is the ends, not the edges."""
    left, left_faces = grid(4, 12)
    right, right_faces = grid(4, 5)
    right = right * [1, 12 / 5, 0] + [4 + 1e-4, 0, 0]
    clean = clean_mesh(np.concatenate([left, right]), np.concatenate([left_faces, right_faces + len(left)]))
    assert clean.report.components == 2


def test_an_honest_border_stays_as_it_is():
    clean = clean_mesh(VERTICES, FACES)
    assert clean.report.welded_vertices == 0 and clean.report.widest_weld == 0
    np.testing.assert_array_equal(clean.faces, FACES)


@pytest.mark.parametrize("copies", [3, 4])
def test_borders_of_more_than_two_parts_are_no_seam(copies):
    """Sheets that meet in a line, like pages of a book: a surface has two at most, so none is welded into an error."""
    page, page_faces = grid(4, 4)
    pages = []
    for k in range(copies):
        angle = 2 * np.pi * k / copies
        turned = page @ np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [0, 0, 1]])
        pages.append(turned + 1e-3 * np.array([np.cos(angle), 0, np.sin(angle)]) * (k + 1))
    faces = np.concatenate([page_faces + k * len(page) for k in range(copies)])
    clean = clean_mesh(np.concatenate(pages), faces)
    assert unique_edges(clean.faces)[1].max() == 2
    assert len(clean.faces) == len(faces)


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_welding_does_not_depend_on_size_place_or_numbering(seed):
    random = np.random.default_rng(seed)
    vertices, faces, part, _ = islands(VERTICES, FACES, random)
    vertices = rounded_by_part(vertices, part, 1e-5, random)
    order = random.permutation(len(vertices))
    other = clean_mesh(1e3 * vertices[order] + random.normal(size=3), np.argsort(order)[faces][:, [1, 2, 0]]).report
    same = clean_mesh(vertices, faces).report
    assert other.welded_vertices == same.welded_vertices == len(vertices) - len(VERTICES)
    assert other.components == same.components == 1
    assert other.boundary_loops == same.boundary_loops == 1


@pytest.mark.parametrize("decimals", [5, 6])
def test_soups_of_triangles_become_a_surface(decimals):
    """As an .stl file, whose numbers have been rounded to one grid: corners of the same place are equal."""
    soup = np.round(VERTICES, decimals)[FACES].reshape(-1, 3)
    clean = clean_mesh(soup, np.arange(len(soup)).reshape(-1, 3))
    assert clean.vertices.shape == VERTICES.shape
    assert border_length(clean.faces) == border_length(FACES)


def test_parts_that_are_hollow_seen_from_outside_keep_their_side():
    """A bowl that opens to the front, as a socket: its normals point into the hollow, and stay so."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    bowl = np.asarray(ball.faces)[np.asarray(ball.vertices)[ball.faces][..., 2].mean(axis=1) < 0.012][:, ::-1]
    vertices = np.concatenate([VERTICES, ball.vertices + np.array([0, 0, 0.3])])
    faces = np.concatenate([FACES, bowl + len(VERTICES)])
    clean = clean_mesh(vertices, faces)
    assert clean.report.turned_faces == 0
    turned = clean_mesh(vertices, np.concatenate([FACES[:, ::-1], bowl + len(VERTICES)]))  # the head itself faces out
    assert turned.report.turned_faces == len(FACES)
