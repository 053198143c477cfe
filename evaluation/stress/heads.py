"""What the robust preset must keep of real heads and of random people, each with its bar.

python -m evaluation.stress.heads results/stress/heads.csv head.obj ... [--head-model ict_model.npz]
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import igl
import numpy as np
from igl.copyleft.cgal import remesh_self_intersections
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from carigs.mesh.triangle_mesh import diagonal, face_normals
from carigs.settings import Exaggerate
from evaluation.benchmarks.surface import read_heads
from evaluation.benchmarks.surface_accuracy import GAMMA, lid_rows, random_person

PEOPLE = 20
SMALL = 6000
"""Vertices: on heads of so many every invariance is tried, each of which looks into the cavities anew."""


class Check(NamedTuple):
    """One number that must not be larger than its bar."""

    case: str
    what: str
    value: float
    bar: float

    @property
    def holds(self) -> bool:
        """False also for what is no number."""
        return self.value <= self.bar


def shape_checks(case: str, solver: Exaggerator) -> Iterator[Check]:
    """No face turns over, nothing grows through anything else, eyes stay in, and the path is as near as it says."""
    vertices, faces, extent = solver.vertices, solver.faces, diagonal(solver.vertices)
    moved = vertices + solver.solve(GAMMA)
    yield Check(case, "level 0: largest displacement", float(np.abs(solver.solve(0.0)).max()), 0.0)
    turned = (face_normals(vertices, faces) * face_normals(moved, faces)).sum(axis=1) <= 0
    yield Check(case, "faces turned by 90 degrees or more", float(turned.sum()), 0.0)
    skin = faces[solver.solved_faces]
    newly = cut_faces(moved, skin) - cut_faces(vertices, skin)
    yield Check(case, "faces that newly cut another, share", len(newly) / len(skin), 1e-3)
    for k, (before, after) in enumerate(zip(depths(vertices, solver), depths(moved, solver), strict=True), start=1):
        yield Check(case, f"eyeball part {k}: deeper in the skin than before, radii", after - before, 0.03)
    path, levels = solver.path(GAMMA), np.linspace(0, GAMMA, 26)
    errors = [
        np.linalg.norm(path.displacement(float(level)) - exact, axis=1).max()
        for level, exact in zip(levels, solver.solve_many(levels), strict=True)
    ]
    yield Check(case, "largest error of the path, diagonals", float(max(errors) / extent), 1e-4)
    yield Check(case, "level 0 of the path: largest displacement", float(np.abs(path.displacement(0.0)).max()), 0.0)


def cut_faces(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> set[int]:
    """Faces that cut others, exactly (CGAL's predicates)."""
    pairs = remesh_self_intersections(vertices, np.asarray(faces, np.int64), detect_only=True)[2]
    return set(pairs.ravel().tolist())


def depths(vertices: Float[np.ndarray, "v 3"], solver: Exaggerator) -> list[float]:
    """How deep the skin reaches into each small component, in its radii."""
    found = []
    for c in np.setdiff1d(solver.component_labels, [solver.main_component]):
        inside = solver.component_labels == c
        centre = vertices[inside].mean(axis=0)
        radius = np.linalg.norm(vertices[inside] - centre, axis=1).max()
        skin = vertices[solver.solved_vertices & (np.linalg.norm(vertices - centre, axis=1) < 1.3 * radius)]
        ball = np.asarray(solver.faces[inside[solver.faces].all(axis=1)])
        found.append(float(-igl.signed_distance(skin, vertices, ball)[0].min() / radius))
    return found


def invariance_checks(
    case: str, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], bar: float = 1e-9
) -> Iterator[Check]:
    """Unit, place, turn and numbering do not matter: largest change of the displacement, in diagonals."""
    extent, random = diagonal(vertices), np.random.default_rng(0)
    # On a grid that coordinates far away still have, so that only the method is tried, not the numbers' rounding.
    grid = 2.0 ** np.round(np.log2(1e6 * extent)) * 2.0**-50
    vertices = np.round(vertices / grid) * grid
    shift = np.round(np.array([0.6, -0.64, 0.48]) * 1e6 * extent / grid) * grid
    turn = Rotation.from_rotvec([0.5, -2.0, 1.0]).as_matrix()
    order = random.permutation(len(vertices))
    shuffled = np.argsort(order)[faces][random.permutation(len(faces))]
    expected = Exaggerator(vertices, faces).solve(GAMMA)
    for what, mesh, back in (
        ("unit 1e-6", (1e-6 * vertices, faces), lambda moved: 1e6 * moved),
        ("unit 1e6", (1e6 * vertices, faces), lambda moved: 1e-6 * moved),
        ("shifted by a million diagonals", (vertices + shift, faces), lambda moved: moved),
        ("turned", (vertices @ turn.T, faces), lambda moved: moved @ turn),
        ("vertices and faces in another order", (vertices[order], shuffled), lambda moved: moved[np.argsort(order)]),
    ):
        change = np.abs(back(Exaggerator(*mesh).solve(GAMMA)) - expected).max() / extent
        yield Check(case, f"{what}: change, diagonals", float(change), bar)


def region_checks(
    case: str,
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    region: Int[np.ndarray, " r"],
) -> Iterator[Check]:
    """A region alone: the border where its ramp ends cannot be seen, and what is beyond stays."""
    edges, _, sides = igl.edge_topology(vertices, np.asarray(faces, np.int64))
    sides = sides.astype(np.int64)  # from C's long long, which NumPy tells apart
    for mode, outside in (("soft", 1e-3), ("exact", 0.0)):
        edit = Exaggerator(vertices, faces, Exaggerate(region_constraint=mode)).local_edit(region)
        displacement = edit.solve(GAMMA)
        beyond = np.linalg.norm(displacement, axis=1)[edit.field == 0].max() / diagonal(vertices)
        yield Check(f"{case}, {mode}", "moved beyond the ramp, diagonals", float(beyond), outside)
        border = (sides >= 0).all(axis=1) & ((edit.field[edges] > 0).sum(axis=1) == 1)
        jump = np.abs(bends(vertices + displacement, faces, sides[border]) - bends(vertices, faces, sides[border]))
        yield Check(f"{case}, {mode}", "jump of normals at the border, 95 %, degrees", np.percentile(jump, 95), 3.0)


def bends(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], sides: Int[np.ndarray, "e 2"]
) -> Float[np.ndarray, " e"]:
    """Angle in degrees between the faces at either side of each edge."""
    a, b = face_normals(vertices, faces)[sides.T]
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))


def checks(heads: dict[str, tuple[np.ndarray, np.ndarray]], model: HeadModel | None, people: int) -> Iterator[Check]:
    """All of them."""
    for name, mesh in heads.items():
        yield from shape_checks(name, Exaggerator(*mesh))
        if len(mesh[0]) <= SMALL:
            yield from invariance_checks(name, *mesh)
    if model is None:
        return
    for seed in range(1, people + 1):
        yield from shape_checks(f"person {seed}", Exaggerator(random_person(model, seed), model.faces))
    yield from region_checks("the nose of the model's mean head", model.v_template, model.faces, model.regions["nose"])
    for row in lid_rows(model, people, ["robust"], ["mixed"]):
        away = abs(row.value / row.reference - 1)
        yield Check(row.case, "closure of the lids under a blink, from the natural one", away, 0.15)


def main() -> int:
    """Write the rows; exit code 1 if one does not hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, help="CSV to write, row by row")
    parser.add_argument("meshes", type=Path, nargs="*", help="heads")
    parser.add_argument("--head-model", type=Path, help="for random people: a model with landmarks and eyeBlink")
    parser.add_argument("--people", type=int, default=PEOPLE, help="how many (default %(default)s)")
    given = parser.parse_args()
    heads, model = read_heads(given.meshes), HeadModel.load(given.head_model) if given.head_model else None
    worst: dict[str, Check] = {}
    failed = []
    given.rows.parent.mkdir(parents=True, exist_ok=True)
    with given.rows.open("w", newline="", encoding="utf-8", buffering=1) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*Check._fields, "holds"])
        for check in checks(heads, model, given.people):
            writer.writerow([check.case, check.what, f"{check.value:.3g}", f"{check.bar:g}", check.holds])
            worst[check.what] = max(worst.get(check.what, check), check, key=lambda c: c.value)
            failed += [] if check.holds else [check]
    for what, check in worst.items():
        print(f"{what}: at most {check.value:.3g} ({check.case}), bar {check.bar:g}")
    print(f"{len(failed)} do not hold" + "".join(f"\n  {c.case}: {c.what}: {c.value:.3g}" for c in failed))
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
