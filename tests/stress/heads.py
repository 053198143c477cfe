"""Invariants of the robust preset on real heads and random people, each with a bound.

Example:
    PYTHONPATH=tests python -m stress.heads results/stress/heads.csv head.obj ... --head-model ict_model.npz
"""

from __future__ import annotations

from collections.abc import Iterator

import igl
import numpy as np
from igl.predicates import find_self_intersections
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from carigs.mesh.deformation import turned_faces
from carigs.mesh.triangle_mesh import diagonal, face_normals
from carigs.settings import Exaggerate
from evaluation.benchmarks.exaggeration.surface_accuracy import GAMMA, measure_lid_closure, path_error, random_person
from evaluation.benchmarks.surface import parse_heads
from evaluation.command_line import run
from stress.case import Measure, Outcome, fails, judged, suite_parser, write_outcomes

PEOPLE = 20
SMALL = 6000
"""Largest number of vertices of a head on which invariances are checked: each computes the occlusion anew."""


def check(case: str, what: str, value: float, bar: float) -> Outcome:
    """Compare a number with its bound.

    Args:
        case: Name of the head.
        what: Name of the invariant.
        value: The number.
        bar: Its bound.

    Returns:
        The outcome: wrong for nan.
    """
    return judged("heads", case, Measure(what, value, bar))


def shape_checks(case: str, solver: Exaggerator) -> Iterator[Outcome]:
    """Check the caricature of a head: no flipped faces, no new intersections, eyes stay inside, accurate path.

    Args:
        case: Name of the head.
        solver: Its solver.

    Yields:
        Checks.
    """
    vertices, faces, extent = solver.vertices, solver.faces, diagonal(solver.vertices)
    moved = vertices + solver.solve(GAMMA)
    yield check(case, "level 0: largest displacement", float(np.abs(solver.solve(0.0)).max()), 0.0)
    turned = turned_faces(vertices, moved, faces)
    yield check(case, "faces turned by 90 degrees or more", float(turned.sum()), 0.0)
    skin = faces[solver.solved_faces]
    new = intersecting_faces(moved, skin) - intersecting_faces(vertices, skin)
    yield check(case, "faces that newly cut another, share", len(new) / len(skin), 1e-3)
    depths = zip(penetration_depths(vertices, solver), penetration_depths(moved, solver), strict=True)
    for k, (before, after) in enumerate(depths, start=1):
        yield check(case, f"eyeball part {k}: deeper in the skin than before, radii", after - before, 0.03)
    path, levels = solver.path(GAMMA), np.linspace(0, GAMMA, 26)
    error = path_error(path, levels, solver.solve_many(levels)) / extent
    yield check(case, "largest error of the path, diagonals", error, 1e-4)
    yield check(case, "level 0 of the path: largest displacement", float(np.abs(path.displacement(0.0)).max()), 0.0)


def intersecting_faces(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> set[int]:
    """Find faces that intersect others, with exact predicates.

    Args:
        vertices: Positions.
        faces: Vertex indices of the triangles.

    Returns:
        Indices of these faces.
    """
    pairs = find_self_intersections(vertices, np.asarray(faces, np.int64))[1]
    return set(pairs.ravel().tolist())


def penetration_depths(vertices: Float[np.ndarray, "v 3"], solver: Exaggerator) -> list[float]:
    """Depth to which the skin reaches into each small component (eyeball part).

    Args:
        vertices: Positions.
        solver: Solver of the head, which knows its components.

    Returns:
        Depths in radii of the component.
    """
    result = []
    for c in np.setdiff1d(solver.component_labels, [solver.main_component]):
        inside = solver.component_labels == c
        centre = vertices[inside].mean(axis=0)
        radius = np.linalg.norm(vertices[inside] - centre, axis=1).max()
        skin = vertices[solver.solved_vertices & (np.linalg.norm(vertices - centre, axis=1) < 1.3 * radius)]
        ball = np.asarray(solver.faces[inside[solver.faces].all(axis=1)])
        result.append(float(-igl.signed_distance(skin, vertices, ball)[0].min() / radius))
    return result


def invariance_checks(
    case: str, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], bar: float = 1e-9
) -> Iterator[Outcome]:
    """Check that the caricature does not depend on unit, position, rotation and numbering.

    Args:
        case: Name of the head.
        vertices: Its vertices.
        faces: Vertex indices of the triangles.
        bar: Largest admissible change of the displacement in diagonals.

    Yields:
        Checks.
    """
    extent, random = diagonal(vertices), np.random.default_rng(0)
    # Round to a grid that is exact after the shift: this checks the method, not the rounding of coordinates.
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
        yield check(case, f"{what}: change, diagonals", float(change), bar)


def region_checks(
    case: str, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], region: Int[np.ndarray, " r"]
) -> Iterator[Outcome]:
    """Check a local edit: vertices beyond its ramp stay, and normals do not jump at the border of the ramp.

    Args:
        case: Name of the region.
        vertices: Vertices of the head.
        faces: Vertex indices of the triangles.
        region: Vertex indices of the region.

    Yields:
        Checks.
    """
    edges, _, sides = igl.edge_topology(vertices, np.asarray(faces, np.int64))
    sides = sides.astype(np.int64)  # libigl returns C's long long, another type to NumPy
    for mode, outside in (("soft", 1e-3), ("exact", 0.0)):
        edit = Exaggerator(vertices, faces, Exaggerate(region_constraint=mode)).local_edit(region)
        displacement = edit.solve(GAMMA)
        beyond = np.linalg.norm(displacement, axis=1)[edit.field == 0].max() / diagonal(vertices)
        yield check(f"{case}, {mode}", "moved beyond the ramp, diagonals", float(beyond), outside)
        border = (sides >= 0).all(axis=1) & ((edit.field[edges] > 0).sum(axis=1) == 1)
        before, after = (dihedral_angles(v, faces, sides[border]) for v in (vertices, vertices + displacement))
        jump = np.abs(after - before)
        yield check(f"{case}, {mode}", "jump of normals at the border, 95 %, degrees", np.percentile(jump, 95), 3.0)


def dihedral_angles(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], sides: Int[np.ndarray, "e 2"]
) -> Float[np.ndarray, " e"]:
    """Angle between the normals of the two faces at each edge.

    Args:
        vertices: Positions.
        faces: Vertex indices of the triangles.
        sides: Indices of the two faces at each edge.

    Returns:
        Angles in degrees.
    """
    a, b = face_normals(vertices, faces)[sides.T]
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))


def checks(heads: dict[str, tuple[np.ndarray, np.ndarray]], model: HeadModel | None, people: int) -> Iterator[Outcome]:
    """Check all heads.

    Args:
        heads: Heads by name.
        model: Head model for random people; None to leave them out.
        people: Number of random people.

    Yields:
        Checks.
    """
    for name, mesh in heads.items():
        yield from shape_checks(name, Exaggerator(*mesh))
        if len(mesh[0]) <= SMALL:
            yield from invariance_checks(name, *mesh)
    if model is None:
        return
    for seed in range(1, people + 1):
        yield from shape_checks(f"person {seed}", Exaggerator(random_person(model, seed), model.faces))
    yield from region_checks("the nose of the model's mean head", model.v_template, model.faces, model.regions["nose"])
    for closure in measure_lid_closure(model, people, ["robust"], ["mixed"]):
        deviation = abs(closure.value / closure.reference - 1)
        yield check(closure.case, "closure of the lids under a blink, from the natural one", deviation, 0.15)


def main() -> bool:
    """Run the checks from the command line, and write them.

    Returns:
        Whether one fails.
    """
    parser = suite_parser(__doc__)
    parser.add_argument("--people", type=int, default=PEOPLE, help="number of random people (default %(default)s)")
    arguments, heads, model = parse_heads(parser)
    results = write_outcomes(arguments, checks(heads, model, arguments.people))
    worst = {result.detail: result for result in sorted(results, key=lambda result: result.error)}
    for what, result in worst.items():
        print(f"{what}: at most {result.error:.3g} ({result.case}), bar {result.tolerance:g}")
    return fails(arguments, results)


if __name__ == "__main__":
    run(main)
