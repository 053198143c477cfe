"""Broken meshes through the door of the exaggeration: the right answer, or a typed error that names the element.

python -m evaluation.stress.surface results/stress/surface.csv [head.obj]
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from carigs.errors import CarigsError
from carigs.exaggeration import Exaggerator
from carigs.files import writing
from carigs.mesh import clean_mesh
from carigs.mesh.triangle_mesh import diagonal
from carigs.settings import Exaggerate
from evaluation.benchmarks.surface import Mesh, read_heads

GAMMA = 0.25
SAME = 1e-9
"""Diagonals: what is mended without a trace."""
NEAR = 2e-3
"""Diagonals: other triangles of the same surface, which have other curvatures; the caricature itself moves by 0.05."""
SETTINGS = Exaggerate(limit_cavities=False)
SEED = 7

Damaged = tuple[np.ndarray, np.ndarray]


class Case(NamedTuple):
    """A way of breaking a mesh."""

    name: str
    damage: Callable[[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]], Damaged]
    """The broken mesh; it begins with the vertices of the sound one."""
    tolerance: float | None
    """Largest distance from the sound mesh's caricature, in diagonals; None: only an error is right."""


class Outcome(NamedTuple):
    """What became of a case."""

    case: str
    outcome: str
    """`right answer`, `WRONG ANSWER`, `no error` or the type of the error."""
    error: float | None
    """Largest distance from the sound mesh's caricature over the vertices of both, in diagonals."""
    tolerance: float | None
    message: str
    """Of the error, or what was mended."""

    @property
    def holds(self) -> bool:
        """Right answer where one was due, typed error else."""
        return self.outcome not in ("WRONG ANSWER", "no error")


def outcomes(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Iterator[Outcome]:
    """Every case on this sound mesh."""
    expected, extent = Exaggerator(vertices, faces, SETTINGS).solve(GAMMA), diagonal(vertices)
    for case in CASES:
        broken = case.damage(vertices.copy(), faces.copy())
        try:
            clean = clean_mesh(*broken)
            moved = clean.to_input(Exaggerator(clean.vertices, clean.faces, SETTINGS).solve(GAMMA))
        except CarigsError as error:
            yield Outcome(case.name, type(error).__name__, None, case.tolerance, str(error))
            continue
        if case.tolerance is None:
            yield Outcome(case.name, "no error", None, None, str(clean.report))
            continue
        used = np.intersect1d(broken[1], np.arange(len(vertices)))
        distance = float(np.linalg.norm(moved[used] - expected[used], axis=1).max() / extent)
        outcome = "right answer" if distance <= case.tolerance else "WRONG ANSWER"
        yield Outcome(case.name, outcome, distance, case.tolerance, str(clean.report))


def split_edges(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], share: float, count: int = 30
) -> Damaged:
    """A vertex on each of `count` edges, at this share from its end: both faces of the edge are cut in two."""
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


def seam(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Damaged:
    """Half of the faces get vertices of their own, as along the seam of a texture."""
    half = vertices[faces].mean(axis=1)[:, 0] > np.median(vertices[:, 0])
    return np.concatenate([vertices, vertices]), np.where(half[:, None], faces + len(vertices), faces)


def touching(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Damaged:
    """A ball that touches the surface in a vertex: same place, another number."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05 * diagonal(vertices))
    tip = vertices[:, 1].argmax()
    moved = np.asarray(ball.vertices) - ball.vertices[ball.vertices[:, 1].argmin()] + vertices[tip]
    return np.concatenate([vertices, moved]), np.concatenate([faces, np.asarray(ball.faces) + len(vertices)])


def with_vertex(value: float) -> Callable[[np.ndarray, np.ndarray], Damaged]:
    """Vertex 9, which faces use, has a coordinate of this value."""

    def damage(vertices: np.ndarray, faces: np.ndarray) -> Damaged:
        vertices[9, 1] = value
        return vertices, faces

    return damage


def fin(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Damaged:
    """A third face on an edge."""
    return np.concatenate([vertices, vertices[:1] + diagonal(vertices)]), np.concatenate(
        [faces, [[*faces[40, :2], len(vertices)]]]
    )


def turned(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Damaged:
    """One face in seven has its corners the other way round."""
    faces[::7] = faces[::7, ::-1]
    return vertices, faces


CASES = (
    *(Case(f"slivers: 30 edges cut at {share:g}", lambda v, f, s=share: split_edges(v, f, s), NEAR)
      for share in (0.5, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)),
    Case("zero-area faces: 30 edges cut at 0", lambda v, f: split_edges(v, f, 0.0), SAME),
    Case("a face that repeats a corner", lambda v, f: (v, np.concatenate([f, f[:1, [0, 0, 1]]])), SAME),
    Case("duplicate faces", lambda v, f: (v, np.concatenate([f, f[:9], f[:9, ::-1]])), SAME),
    Case("a seam", seam, SAME),
    Case("a fin", fin, None),
    Case("isolated vertices", lambda v, f: (np.concatenate([v, 2 * v[:5]]), f), SAME),
    Case("an isolated vertex that is not finite", lambda v, f: (np.concatenate([v, [[np.nan, 0, 0]]]), f), SAME),
    Case("1/7 of the faces turned", turned, SAME),
    Case("one face missing", lambda v, f: (v, np.delete(f, len(f) // 2, axis=0)), NEAR),
    Case("two components that touch", touching, NEAR),  # the ball counts in the size of the head
    Case("nan", with_vertex(np.nan), None),
    Case("inf", with_vertex(np.inf), None),
    Case("a corner that is no vertex", lambda v, f: (v, np.concatenate([f, [[0, 1, len(v)]]])), None),
    Case("no faces", lambda v, f: (v, f[:0]), None),
    Case("an empty mesh", lambda v, f: (v[:0], f[:0]), None),
    Case("one triangle", lambda v, f: (v[f[0]], np.array([[0, 1, 2]])), None),
    Case("all vertices in one place", lambda v, f: (np.ones_like(v), f), None),
)  # fmt: skip


def write_outcomes(file: Path, rows: Sequence[Outcome]) -> None:
    """The table as CSV."""
    with writing(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(Outcome._fields)
        for row in rows:
            writer.writerow(
                ["" if field is None else f"{field:.2g}" if isinstance(field, float) else field for field in row]
            )


def sound_mesh() -> Mesh:
    """A bumpy ball, open below: where no head is given."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    faces = faces[vertices[faces].mean(axis=1)[:, 1] > -0.7]
    used, corner = np.unique(faces, return_inverse=True)
    vertices = vertices[used]
    return vertices * (1 + 0.1 * np.sin(5 * vertices[:, :1]) * np.cos(4 * vertices[:, 1:2])), corner.reshape(-1, 3)


def main(arguments: Sequence[str]) -> int:
    """Exit code 1 if a case does not hold."""
    file, *meshes = map(Path, arguments)
    vertices, faces = next(iter(read_heads(meshes).values())) if meshes else sound_mesh()
    rows = list(outcomes(vertices, faces))
    write_outcomes(file, rows)
    failed = [row.case for row in rows if not row.holds]
    print(f"{len(rows)} cases, {len(failed)} do not hold" + "".join(f"\n  {name}" for name in failed))
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
