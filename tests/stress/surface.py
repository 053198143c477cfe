"""Broken meshes: the exaggeration gives the right answer, or a typed error that names the element.

Example:
    PYTHONPATH=tests python -m stress.surface results/stress/surface.csv head.obj
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from carigs.exaggeration import Exaggerator
from carigs.mesh import clean_mesh
from carigs.mesh.triangle_mesh import diagonal
from carigs.settings import Exaggerate
from evaluation.benchmarks.surface import Mesh, read_heads
from evaluation.command_line import run
from stress.case import Case, Measure, examine, fails, suite_parser, write_outcomes

GAMMA = 0.25
SAME = 1e-9
"""Tolerance in diagonals where the repair restores the mesh."""
NEAR = 2e-3
"""Tolerance in diagonals where other triangles, hence other curvatures, remain; the caricature itself moves by 0.05."""
SETTINGS = Exaggerate(limit_cavities=False)
SEED = 7


class Damage(NamedTuple):
    """A way of breaking a mesh."""

    name: str
    change: Callable[[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]], Mesh]
    """Returns the broken mesh, which begins with the vertices of the sound one."""
    tolerance: float | None
    """Largest distance from the caricature of the sound mesh in diagonals; None if only an error is right."""


def cases(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Iterator[Case]:
    """All cases.

    Args:
        vertices: Vertices of a sound mesh.
        faces: Vertex indices of its triangles.

    Yields:
        Cases.
    """
    expected = Exaggerator(vertices, faces, SETTINGS).solve(GAMMA)
    for damage in DAMAGES:
        measure = partial(caricature_error, damage, vertices, faces, expected)
        yield Case(damage.name, measure, invalid=damage.tolerance is None)


def caricature_error(
    damage: Damage,
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    expected: Float[np.ndarray, "v 3"],
) -> list[Measure]:
    """Break a mesh, repair and exaggerate it.

    Args:
        damage: How to break it.
        vertices: Vertices of the sound mesh.
        faces: Vertex indices of its triangles.
        expected: Displacement of the sound mesh.

    Returns:
        Largest distance from the caricature of the sound mesh, over the vertices of both.

    Raises:
        MeshError: The mesh cannot be repaired.
    """
    broken = damage.change(vertices.copy(), faces.copy())
    clean = clean_mesh(*broken)
    moved = clean.to_input(Exaggerator(clean.vertices, clean.faces, SETTINGS).solve(GAMMA))
    if damage.tolerance is None:
        return []
    used = np.intersect1d(broken[1], np.arange(len(vertices)))
    distance = np.linalg.norm(moved[used] - expected[used], axis=1).max() / diagonal(vertices)
    return [Measure(f"diagonals; repairs: {clean.report}", float(distance), damage.tolerance)]


def split_edges(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], share: float, count: int = 30
) -> Mesh:
    """Insert a vertex on each of some edges, which splits both faces of the edge.

    Args:
        vertices: Positions.
        faces: Vertex indices of the triangles.
        share: Position of the new vertex along its edge, between 0 and 1.
        count: Number of edges.

    Returns:
        The broken mesh.
    """
    random = np.random.default_rng(SEED)
    vertices, faces = list(vertices), [tuple(face) for face in faces]
    touched: set[int] = set()
    of_edge = {(face[k], face[(k + 1) % 3]): f for f, face in enumerate(faces) for k in range(3)}
    for f in random.permutation(len(faces)):
        i, j, k = faces[f]
        other = of_edge.get((j, i))
        if other is None or {f, other} & touched:
            continue
        touched |= {f, other}
        (far,) = set(faces[other]) - {i, j}
        new = len(vertices)
        vertices.append((1 - share) * vertices[i] + share * vertices[j])
        faces[f], faces[other] = (new, j, k), (new, i, far)
        faces += [(i, new, k), (j, new, far)]
        if len(touched) == 2 * count:
            break
    return np.array(vertices), np.array(faces)


def _seam(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Mesh:
    """Give half of the faces vertices of their own, as along a texture seam."""
    half = vertices[faces].mean(axis=1)[:, 0] > np.median(vertices[:, 0])
    return np.concatenate([vertices, vertices]), np.where(half[:, None], faces + len(vertices), faces)


def _touching_ball(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Mesh:
    """Add a ball that touches the surface in one vertex: same position, another index."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05 * diagonal(vertices))
    tip = vertices[:, 1].argmax()
    moved = np.asarray(ball.vertices) - ball.vertices[ball.vertices[:, 1].argmin()] + vertices[tip]
    return np.concatenate([vertices, moved]), np.concatenate([faces, np.asarray(ball.faces) + len(vertices)])


def _with_coordinate(value: float) -> Callable[[np.ndarray, np.ndarray], Mesh]:
    """Set a coordinate of vertex 9, which faces use."""
    return lambda v, f: (np.concatenate([v[:9], [[v[9, 0], value, v[9, 2]]], v[10:]]), f)


def _fin(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Mesh:
    """Add a third face to an edge."""
    fin = [*faces[40, :2], len(vertices)]
    return np.concatenate([vertices, vertices[:1] + diagonal(vertices)]), np.concatenate([faces, [fin]])


DAMAGES = (
    *(Damage(f"slivers: 30 edges cut at {share:g}", lambda v, f, s=share: split_edges(v, f, s), NEAR)
      for share in (0.5, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)),
    Damage("zero-area faces: 30 edges cut at 0", lambda v, f: split_edges(v, f, 0.0), SAME),
    Damage("a face that repeats a corner", lambda v, f: (v, np.concatenate([f, f[:1, [0, 0, 1]]])), SAME),
    Damage("duplicate faces", lambda v, f: (v, np.concatenate([f, f[:9], f[:9, ::-1]])), SAME),
    Damage("a seam", _seam, SAME),
    Damage("a fin", _fin, None),
    Damage("isolated vertices", lambda v, f: (np.concatenate([v, 2 * v[:5]]), f), SAME),
    Damage("an isolated vertex that is not finite", lambda v, f: (np.concatenate([v, [[np.nan, 0, 0]]]), f), SAME),
    Damage("1/7 of the faces turned", lambda v, f: (v, np.where(np.arange(len(f))[:, None] % 7, f, f[:, ::-1])), SAME),
    Damage("one face missing", lambda v, f: (v, np.delete(f, len(f) // 2, axis=0)), NEAR),
    Damage("two components that touch", _touching_ball, NEAR),  # the ball counts in the size of the head
    Damage("nan", _with_coordinate(np.nan), None),
    Damage("inf", _with_coordinate(np.inf), None),
    Damage("a corner that is no vertex", lambda v, f: (v, np.concatenate([f, [[0, 1, len(v)]]])), None),
    Damage("no faces", lambda v, f: (v, f[:0]), None),
    Damage("an empty mesh", lambda v, f: (v[:0], f[:0]), None),
    Damage("one triangle", lambda v, f: (v[f[0]], np.array([[0, 1, 2]])), None),
    Damage("all vertices in one place", lambda v, f: (np.ones_like(v), f), None),
)  # fmt: skip


def sound_mesh() -> Mesh:
    """Bumpy ball with an opening below, used where no head is given.

    Returns:
        The mesh.
    """
    ball = trimesh.creation.icosphere(subdivisions=4)
    ball.update_faces(ball.triangles_center[:, 1] > -0.7)
    ball.remove_unreferenced_vertices()
    v = np.asarray(ball.vertices)
    return v * (1 + 0.1 * np.sin(5 * v[:, :1]) * np.cos(4 * v[:, 1:2])), np.asarray(ball.faces)


def main() -> bool:
    """Run all cases from the command line, and write their outcomes.

    Returns:
        Whether the program fails.
    """
    parser = suite_parser(__doc__)
    parser.add_argument("mesh", type=Path, nargs="?", help="head (default: a bumpy ball)")
    arguments = parser.parse_args()
    mesh = read_heads([arguments.mesh])[arguments.mesh.stem] if arguments.mesh else sound_mesh()
    return fails(arguments, write_outcomes(arguments, (examine("surface", case) for case in cases(*mesh))))


if __name__ == "__main__":
    run(main)
