"""Triangle motions, skinning and posing at special angles, in any unit, and with triangles that have no area.

Example:
    PYTHONPATH=tests python -m stress.rig results/stress/rig.csv
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.similarity_motion import similarity_motion
from evaluation.command_line import run
from stress import posing, skinning
from stress.case import Case, Measure, difference, run_suite, violations
from stress.deformations import DEFORMATIONS, SINGLE, deformation_gradients
from stress.meshes import ball
from stress.posing import ANGLES, PI

UNITS = (1e-6, 1e-3, 1.0, 1e3, 1e6)


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for angle, unit in product(ANGLES, (1e-6, 1.0, 1e6)):
        yield Case(f"hinge of {angle:.17g}, unit {unit:g}", partial(hinge, angle, unit))
    for angle, unit, shift in product((0.0, 1e-12, 1.0, PI, 2 * PI), UNITS, (0.0, 10.0)):
        name = f"rigid motion by {angle:.3g} with size times {unit:g}, {shift:g} sizes away"
        yield Case(name, partial(rigid_motion, angle, unit, shift))
    for (change, move), unit in product(DEFORMATIONS.items(), (1e-6, 1.0, 1e6)):
        yield Case(f"{change}, unit {unit:g}", partial(deformation, move, unit))
    for height in 10.0 ** -np.arange(1, 13):
        yield Case(f"triangles of height {height:g} become flat", partial(flattened, height, False))
        yield Case(f"flat triangles of height {height:g} open", partial(flattened, height, True))
    for name, damage in DEGENERATE.items():
        yield Case(f"{name} follow their neighbours", partial(followers, damage))
    yield Case("a mesh without area", no_area)
    for value in (np.nan, np.inf, -np.inf):
        yield Case(f"canonical vertex is {value}", partial(broken_mesh, value, True), invalid=True)
        yield Case(f"posed vertex is {value}", partial(broken_mesh, value, False), invalid=True)
    yield from skinning.cases()
    yield from posing.cases()


DEGENERATE: dict[str, Callable[[np.ndarray, np.ndarray], None]] = {
    "faces with corners on a line": lambda v, corners: v.__setitem__(corners[2], v[corners[:2]].mean(axis=0)),
    "faces with two corners in one place": lambda v, corners: v.__setitem__(corners[2], v[corners[0]]),
    "faces with all corners in one place": lambda v, corners: v.__setitem__(corners, v[corners[0]]),
}


def hinge(angle: float, unit: float) -> Iterator[Measure]:
    """Two triangles with a common edge, of which one is turned about the edge.

    Args:
        angle: Angle of the turn in radians.
        unit: Factor on all lengths.

    Yields:
        Errors of rotations, of the relative rotation vector and of the stretch.
    """
    flat = unit * np.array([[0.0, 0, 0], [1, 0, 0], [0.4, -0.8, 0], [0.3, 0.9, 0]])
    faces = np.array([[0, 1, 3], [1, 0, 2]])
    turn = Rotation.from_rotvec([angle, 0, 0]).as_matrix()
    posed = flat.copy()
    posed[2] = turn @ flat[2]
    motion = face_motion(build_rig(flat, faces), posed)
    yield difference("rotations", motion.rotation, np.stack([np.eye(3), turn]), SINGLE)
    yield difference("stretches", motion.stretch, np.tile([1.0, 0, 0, 1, 0, 1], (2, 1)), SINGLE)
    short = (angle + PI) % (2 * PI) - PI
    vector = motion.relative_rotation[0, 0].astype(np.float64)
    expected = np.array([short, 0, 0])
    # At half a turn either sign is right.
    error = min(np.abs(vector - expected).max(), np.abs(vector + expected).max() if abs(short) > PI - 1e-5 else np.inf)
    yield Measure("relative rotation vector, radians", float(error), SINGLE)


def rigid_motion(angle: float, unit: float, shift: float) -> Iterator[Measure]:
    """A mesh in any unit, turned, scaled and moved.

    Args:
        angle: Angle of the turn in radians.
        unit: Factor on the size.
        shift: Distance of the motion in sizes.

    Yields:
        Errors of rotations, stretches, centres and relative rotations.
    """
    vertices, faces = ball(1)
    turn = Rotation.from_rotvec(angle * np.array([2, -1, 2]) / 3).as_matrix()
    offset = unit * shift * np.array([1.0, -1, 0.5])
    rig = build_rig(vertices, faces)
    posed = unit * vertices @ turn.T + offset
    motion = face_motion(rig, posed)
    n = len(faces)
    yield difference("rotations", motion.rotation, np.tile(turn, (n, 1, 1)), SINGLE)
    yield difference("stretches", motion.stretch / unit, np.tile([1.0, 0, 0, 1, 0, 1], (n, 1)), SINGLE)
    yield difference("relative rotations", motion.relative_rotation, 0.0, SINGLE)
    size = np.abs(posed).max()
    yield difference("centres", motion.centre / size, posed[faces].mean(axis=1) / size, SINGLE)
    similar = similarity_motion(rig, motion)
    yield difference("rotations of the similarity", similar.rotation, motion.rotation, 2 * SINGLE)
    yield difference("scales of the similarity", similar.stretch / unit, motion.stretch / unit, 2 * SINGLE)


def deformation(move: Callable[[np.ndarray], np.ndarray], unit: float) -> Iterator[Measure]:
    """Motion of a deformed mesh against SVD.

    Args:
        move: The deformation.
        unit: Factor on all lengths.

    Yields:
        Errors of rotation and stretch, and of the Jacobian on the edges.
    """
    vertices, faces = ball(1)
    vertices = unit * vertices
    posed = move(vertices)
    motion = face_motion(build_rig(vertices, faces), posed)
    jacobians = deformation_gradients(vertices, posed, faces)
    parts = [polar(jacobian) for jacobian in jacobians]
    yield difference("rotations", motion.rotation, np.stack([u for u, _ in parts]), 5 * SINGLE)
    stretches = np.stack([p for _, p in parts])
    sizes = np.linalg.norm(stretches, axis=(1, 2), keepdims=True)
    found = motion.stretch[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    yield difference("stretches over their norm", found / sizes, stretches / sizes, SINGLE)
    yield difference("determinants of the rotations", np.linalg.det(motion.rotation), 1.0, SINGLE)
    yield violations(
        "negative stretches", np.linalg.eigvalsh(found.astype(np.float64))[:, 0] < -SINGLE * sizes[:, 0, 0]
    )


def flattened(height: float, reverse: bool) -> Iterator[Measure]:
    """A strip of triangles whose height shrinks until they have none.

    Args:
        height: Height of the flat triangles over their length.
        reverse: Whether the flat ones are canonical.

    Yields:
        Errors of the Jacobian where the triangles have an area, and values that are not finite or not rotations.
    """
    tall = np.array([[k / 2, k % 2, 0.1 * k] for k in range(8)], float)
    faces = np.array([[k, k + 1, k + 2] if k % 2 else [k + 1, k, k + 2] for k in range(6)])
    flat = tall * [1, height, 1]
    canonical, posed = (flat, tall) if reverse else (tall, flat)
    motion = face_motion(build_rig(canonical, faces), posed)
    yield violations("numbers that are not finite", ~np.isfinite(motion.records))
    turned = motion.rotation.astype(np.float64) @ motion.rotation.transpose(0, 2, 1)
    yield difference("U U^T - I", turned, np.tile(np.eye(3), (len(faces), 1, 1)), 1e-5)
    yield difference("determinants", np.linalg.det(motion.rotation), 1.0, 1e-5)
    if height > 1e-5:
        edges = canonical[faces[:, 1:]] - canonical[faces[:, :1]]
        expected = posed[faces[:, 1:]] - posed[faces[:, :1]]
        size = np.linalg.norm(motion.jacobian, axis=(1, 2))[:, None, None]
        moved = np.einsum("fij,fkj->fki", motion.jacobian, edges)
        yield difference("moved edges over the norm of J", moved / size, expected / size, SINGLE)


def followers(damage: Callable[[np.ndarray, np.ndarray], None]) -> Iterator[Measure]:
    """Faces without area on a mesh that moves rigidly turn with it.

    Args:
        damage: Changes the corners of a face in place.

    Yields:
        Errors of rotations and stretches, for damage in the canonical mesh, the posed one and both.
    """
    vertices, faces = ball(2)
    turn = Rotation.from_rotvec([0.4, -1.3, 2.0]).as_matrix()
    damaged = vertices.copy()
    damage(damaged, faces[7])
    area = np.linalg.norm(np.cross(*(damaged[faces[:, k]] - damaged[faces[:, 0]] for k in (1, 2))), axis=1)
    flat = area < 1e-9
    yield Measure("faces without area, fewer than one", float(1 - flat.sum()))
    for canonical, posed in ((damaged, damaged), (damaged, vertices), (vertices, damaged)):
        motion = face_motion(build_rig(canonical, faces), posed @ turn.T)
        yield violations("numbers that are not finite", ~np.isfinite(motion.records))
        determinants = np.linalg.det(motion.rotation)
        yield difference("determinants", determinants, 1.0, 1e-5)
        if canonical is posed:
            yield difference("rotations", motion.rotation, np.tile(turn, (len(faces), 1, 1)), SINGLE)
            yield difference("stretches", motion.stretch, np.tile([1.0, 0, 0, 1, 0, 1], (len(faces), 1)), SINGLE)


def no_area() -> Iterator[Measure]:
    """All vertices in one place: the identity, moved to the place of the posed vertices.

    Yields:
        Differences.
    """
    faces = ball(0)[1]
    motion = face_motion(build_rig(np.ones((12, 3)), faces), 3 * np.ones((12, 3)))
    yield difference("rotations", motion.rotation, np.tile(np.eye(3), (len(faces), 1, 1)), 0.0)
    yield difference("centres", motion.centre, 3.0, 0.0)
    yield difference("relative rotations", motion.relative_rotation, 0.0, 0.0)


def broken_mesh(value: float, canonical: bool) -> list[Measure]:
    """A vertex that is not finite.

    Args:
        value: Its coordinate.
        canonical: Whether it is a vertex of the canonical mesh.

    Returns:
        Nothing: it is an error.
    """
    vertices, faces = ball(1)
    broken = vertices.copy()
    broken[3, 1] = value
    face_motion(build_rig(broken if canonical else vertices, faces), vertices if canonical else broken)
    return []


if __name__ == "__main__":
    run(lambda: run_suite(__doc__, "rig", cases()))
