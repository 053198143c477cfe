"""Triangle motions, skinning and posing at special angles, in any unit, and with triangles that have no area.

Example:
    python -m evaluation.stress.rig results/stress/rig.csv
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np
import torch
from jaxtyping import Float, Float64
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from carigs.head import HeadModel, HeadParameters, pose
from carigs.head.posing import rotation_matrices
from carigs.splat.rig.mesh_gradient import differentiable_face_motion
from carigs.splat.rig.rig import Rig, build_rig, face_motion
from carigs.splat.rig.similarity_motion import similarity_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import Surfels
from evaluation.command_line import run
from evaluation.stress.case import Case, Measure, difference, run_suite, violations
from evaluation.stress.meshes import ball

SINGLE = 2e-6
"""Tolerance of what is stored in float32, relative to its size."""
PI = np.pi
ANGLES = (0.0, 1e-300, 1e-12, 1e-8, 1e-4, 1.0, PI / 2, PI - 1e-6, PI - 1e-9, PI, PI + 1e-9, 2 * PI, 2 * PI + 1e-9, 1e4)
AXES = {"x": (1, 0, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "diagonal": (1, 1, 1), "oblique": (0.3, -2.0, 0.7)}
UNITS = (1e-6, 1e-3, 1.0, 1e3, 1e6)


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for angle, (axis, direction) in product(ANGLES, AXES.items()):
        vector = angle * np.array(direction) / np.linalg.norm(direction)
        yield Case(f"rotation by {angle:.17g} about {axis}", partial(rotation, vector))
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
    for (change, move), count, blend in product(DEFORMATIONS.items(), (3, 20), (False, True)):
        name = f"{count} surfels, {change}, {'blended' if blend else 'own triangles'}"
        yield Case(name, partial(skinned, move, count, blend))
    for name, change in (("as it is", DEFORMATIONS["as it is"]), ("with noise", DEFORMATIONS["with noise"])):
        yield Case(f"gradient of skinning, {name}", partial(skinning_gradient, change))
        yield Case(f"gradient of the motion of triangles, {name}", partial(motion_gradient, change))
    for name, damage in DEGENERATE.items():
        yield Case(f"{name} follow their neighbours", partial(followers, damage))
    yield Case("a mesh without area", no_area)
    for joints, angle in product((1, 2, 5, 20), (0.0, 1e-12, 0.3, PI, 2 * PI)):
        yield Case(f"chain of {joints} joints, each turned by {angle:.3g}", partial(chain, joints, angle))
    for value in (np.nan, np.inf, -np.inf):
        yield Case(f"canonical vertex is {value}", partial(broken_mesh, value, True), invalid=True)
        yield Case(f"posed vertex is {value}", partial(broken_mesh, value, False), invalid=True)
        yield Case(f"translation is {value}", partial(broken_pose, {"translation": np.full(3, value)}), invalid=True)
        yield Case(f"rotation is {value}", partial(broken_pose, {"rotation": np.full(3, value)}), invalid=True)
    yield Case("translation by 1e9 m", partial(broken_pose, {"translation": np.full(3, 1e9)}), invalid=True)
    yield Case("too many joints", partial(broken_pose, {"joints": np.zeros((9, 3))}), invalid=True)
    yield Case("too few expressions", partial(broken_pose, {"expression": np.zeros(1)}), invalid=True)


DEFORMATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as it is": lambda v: v,
    "mirrored": lambda v: v * [-1, 1, 1],
    "inverted": lambda v: -v,
    "stretched a thousand times": lambda v: v * [1e3, 1, 1],
    "nearly flat": lambda v: v * [1, 1, 1e-3],
    "sheared": lambda v: v @ np.array([[1, 0, 0], [5, 1, 0], [0, -3, 1]]),
    "turned by pi": lambda v: v * [-1, -1, 1],
    "with noise": lambda v: v + 0.05 * np.abs(v).max() * np.random.default_rng(4).normal(size=v.shape),
    "tiny": lambda v: 1e-6 * v,
    "huge": lambda v: 1e6 * v,
}
DEGENERATE: dict[str, Callable[[np.ndarray, np.ndarray], None]] = {
    "faces with corners on a line": lambda v, corners: v.__setitem__(corners[2], v[corners[:2]].mean(axis=0)),
    "faces with two corners in one place": lambda v, corners: v.__setitem__(corners[2], v[corners[0]]),
    "faces with all corners in one place": lambda v, corners: v.__setitem__(corners, v[corners[0]]),
}


def rotation(vector: Float64[np.ndarray, "3"]) -> Iterator[Measure]:
    """Rodrigues' formula against quaternions.

    Args:
        vector: Rotation vector in radians.

    Yields:
        Errors; the angle itself is rounded, hence a tolerance in proportion to it.
    """
    found, angle = rotation_matrices(vector), float(np.linalg.norm(vector))
    tolerance = 1e-14 + 4e-16 * angle
    axis = vector / angle if angle else np.array([1.0, 0, 0])
    half = 0.5 * angle
    expected = Rotation.from_quat([*(np.sin(half) * axis), np.cos(half)]).as_matrix()
    yield difference("rotation matrix", found, expected, 3 * tolerance)
    yield difference("R R^T - I", found @ found.T, np.eye(3), 1e-14)
    yield difference("determinant", np.linalg.det(found), 1.0, 1e-14)
    yield difference("axis", found @ axis, axis, tolerance)


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


def deformation_gradients(
    canonical: Float[np.ndarray, "v 3"], posed: Float[np.ndarray, "v 3"], faces: np.ndarray
) -> Float64[np.ndarray, "f 3 3"]:
    """Jacobians from the edges and the normals (Sumner and Popovic 2004).

    Args:
        canonical: Vertices.
        posed: Vertices after the motion.
        faces: Vertex indices of the triangles.

    Returns:
        J with J e = e' for the edges, and for the normals n of length sqrt(2 area).
    """

    def frames(vertices: np.ndarray) -> np.ndarray:
        edges = (vertices[faces][:, 1:] - vertices[faces][:, :1]).transpose(0, 2, 1)
        normal = np.cross(edges[:, :, 0], edges[:, :, 1])
        return np.concatenate([edges, (normal / np.linalg.norm(normal, axis=1)[:, None] ** 0.5)[:, :, None]], axis=2)

    return frames(posed) @ np.linalg.inv(frames(canonical))


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


def random_surfels(count: int, faces: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Surfels:
    """Surfels with attributes of all sizes.

    Args:
        count: Number of surfels.
        faces: Number of triangles.
        seed: Seed of the attributes.
        dtype: Type of the tensors.

    Returns:
        The surfels.
    """
    random = np.random.default_rng(seed)
    blend = random.choice([-1e4, -60.0, -3.0, 0.0, 2.0, 1e4], (count, 4))

    def leaf(values: np.ndarray) -> torch.Tensor:
        return torch.tensor(values, dtype=dtype, requires_grad=True)

    return Surfels(
        position=leaf(random.normal(size=(count, 3))),
        rotation=leaf(random.normal(size=(count, 4)) * 10 ** random.uniform(-10, 10, (count, 1))),
        log_scale=leaf(random.uniform(-12, 3, (count, 2))),
        opacity=leaf(random.choice([-100.0, -1.0, 0.0, 30.0, 100.0], count)),
        colour=leaf(random.random((count, 3))),
        harmonics=leaf(np.zeros((count, 0, 3))),
        blend=leaf(blend),
        binding=np.sort(random.integers(0, faces, count)).astype(np.int32),
    )


def skin_by_matrices(
    surfels: Surfels, rig: Rig, posed: Float[np.ndarray, "v 3"], blend: bool
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 2"]]:
    """Jacobian blend skinning by SciPy's rotations and polar decompositions, surfel by surfel.

    Args:
        surfels: The surfels.
        rig: Canonical mesh.
        posed: Posed vertices.
        blend: Whether neighbours are blended.

    Returns:
        Centres and the two tangents.
    """
    jacobians = deformation_gradients(rig.vertices, posed, rig.faces)
    rotations, stretches = (np.stack(part) for part in zip(*(polar(jacobian) for jacobian in jacobians), strict=True))
    position, quaternion, log_scale, logits = (
        getattr(surfels, name).detach().double().numpy() for name in ("position", "rotation", "log_scale", "blend")
    )
    frame = rig.frame.astype(np.float64)
    centres, tangents = [], []
    for i, f in enumerate(surfels.binding):
        around = [f, *rig.neighbours[f]]
        weights = 1 / (1 + np.exp(-np.maximum(logits[i], -60))) if blend else np.array([1.0, 0, 0, 0])
        weights = weights / weights.sum()
        relative = [Rotation.from_matrix(rotations[f].T @ rotations[g]).as_rotvec() for g in around]
        turn = rotations[f] @ Rotation.from_rotvec(weights @ np.array(relative)).as_matrix()
        jacobian = turn @ np.einsum("k,kij->ij", weights, stretches[around])
        axes = Rotation.from_quat(np.roll(quaternion[i] / np.abs(quaternion[i]).max(), -1)).as_matrix()[:, :2]
        centres.append(jacobian @ frame[f] @ position[i] + posed[rig.faces[f]].mean(axis=0))
        tangents.append(jacobian @ frame[f] @ axes * np.exp(log_scale[i]))
    return np.array(centres), np.array(tangents)


def skinned(move: Callable[[np.ndarray], np.ndarray], count: int, blend: bool) -> Iterator[Measure]:
    """Surfels with extreme attributes on a deformed mesh, against matrices.

    Args:
        move: The deformation.
        count: Number of surfels: fewer than sixteen take another code path.
        blend: Whether neighbours are blended.

    Yields:
        Errors relative to the size of a surfel's motion, and values that are not finite.
    """
    vertices, faces = ball(1)
    rig, surfels, posed = build_rig(vertices, faces), random_surfels(count, len(faces)), move(vertices)
    world = jacobian_blend_skinning(surfels, rig, face_motion(rig, posed), blend=blend)
    centres, tangents = skin_by_matrices(surfels, rig, posed, blend)
    size = np.abs(posed).max()
    yield difference(
        "centres over the size of the mesh", world.centre.detach().numpy() / size, centres / size, 5 * SINGLE
    )
    for k, tangent in enumerate((world.tangent_u, world.tangent_v)):
        length = np.linalg.norm(tangents[:, :, k], axis=1, keepdims=True)
        # Relative to the longest tangent that the Jacobian could make of this disc.
        longest = np.linalg.norm(deformation_gradients(vertices, posed, faces), axis=(1, 2)).max()
        longest = longest * rig.scale.max() * np.exp(surfels.log_scale.detach().numpy()[:, k : k + 1])
        unit = np.maximum(length, longest)
        yield difference(
            "tangents over their length", tangent.detach().numpy() / unit, tangents[:, :, k] / unit, 5 * SINGLE
        )
    sum(value.double().abs().sum() / size for value in world[:3]).backward()
    for name in ("position", "rotation", "log_scale", "blend"):
        gradient = getattr(surfels, name).grad
        yield violations(f"gradients of {name} that are not finite", ~gradient.isfinite().numpy())


def directional_error(
    function: Callable[..., torch.Tensor], leaves: list[torch.Tensor], step: float, seed: int = 0
) -> float:
    """Difference of a gradient from central differences along a random direction.

    Args:
        function: From the tensors to a number.
        leaves: float64 tensors.
        step: Length of the step.
        seed: Seed of the direction.

    Returns:
        Largest error over the tensors, one direction for each, relative to the sizes of gradient and function.
    """
    value = function(*leaves)
    gradients = torch.autograd.grad(value, leaves)
    worst = 0.0
    for k, gradient in enumerate(gradients):
        generator = torch.Generator().manual_seed(seed + k)
        direction = torch.randn(gradient.shape, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            ends = [
                function(*(leaf + sign * step * direction if j == k else leaf for j, leaf in enumerate(leaves)))
                for sign in (1, -1)
            ]
        numeric = float(ends[0] - ends[1]) / (2 * step)
        analytic = float((gradient * direction).sum())
        scale = float(gradient.norm() * direction.norm() + value.abs().detach())
        worst = max(worst, abs(numeric - analytic) / scale)
    return worst


def skinning_gradient(move: Callable[[np.ndarray], np.ndarray]) -> Iterator[Measure]:
    """Gradient of skinning against finite differences in float64.

    Args:
        move: Deformation of the mesh.

    Yields:
        Relative error.
    """
    vertices, faces = ball(1)
    rig = build_rig(vertices, faces)
    motion = face_motion(rig, move(vertices))
    surfels = random_surfels(12, len(faces), dtype=torch.float64)
    random = np.random.default_rng(1)
    values = [torch.tensor(random.normal(size=shape)) for shape in ((12, 3), (12, 4), (12, 2), (12,), (12, 4))]
    weights = [torch.tensor(random.normal(size=shape)) for shape in ((12, 3), (12, 3), (12, 3), (12,), (12, 3))]
    names = ("position", "rotation", "log_scale", "opacity", "blend")

    def total(*leaves: torch.Tensor) -> torch.Tensor:
        for name, leaf in zip(names, leaves, strict=True):
            setattr(surfels, name, leaf)
        world = jacobian_blend_skinning(surfels, rig, motion, eye=np.array([0.1, 0.2, 3.0]))
        return sum((value * weight).sum() for value, weight in zip(world, weights, strict=True))

    leaves = [value.requires_grad_(True) for value in values]
    yield Measure("relative error of directional derivatives", directional_error(total, leaves, 1e-5), 1e-8)


def motion_gradient(move: Callable[[np.ndarray], np.ndarray]) -> Iterator[Measure]:
    """Gradient with respect to the posed vertices against finite differences; records are float32.

    Args:
        move: Deformation of the mesh.

    Yields:
        Relative error.
    """
    vertices, faces = ball(1)
    rig, posed = build_rig(vertices, faces), torch.tensor(move(vertices), requires_grad=True)
    weights = torch.randn((len(faces), 27), generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def total(leaf: torch.Tensor) -> torch.Tensor:
        return (differentiable_face_motion(rig, leaf).records[:, :27].double() * weights).sum()

    yield Measure("relative error of a directional derivative", directional_error(total, [posed], 1e-3), 1e-3)


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


def chain_model(joints: int) -> HeadModel:
    """A rod along x whose joints lie one metre apart; vertex k belongs to joint k, one more sits at the end of the rod.

    Args:
        joints: Number of joints.

    Returns:
        The model.
    """
    v = joints + 2
    vertices = np.zeros((v, 3), np.float32)
    vertices[:-1, 0] = np.arange(joints + 1)
    vertices[-1] = [joints, 1, 0]
    weights = np.zeros((v, joints), np.float32)
    weights[np.arange(v), np.minimum(np.arange(v), joints - 1)] = 1
    regressor = np.eye(joints, v, dtype=np.float32)
    return HeadModel(
        v_template=vertices,
        faces=np.array([[0, 1, 2]]),
        shapedirs=np.zeros((v, 3, 2), np.float32),
        posedirs=np.zeros((v, 3, 0), np.float32),
        joint_regressor=regressor,
        weights=weights,
        parents=np.arange(joints) - 1,
        num_identity=0,
    )


def chain(joints: int, angle: float) -> Iterator[Measure]:
    """A rod that bends at each joint about z: its joints lie on a regular polygon.

    Args:
        joints: Number of joints.
        angle: Angle at each joint in radians.

    Yields:
        Distance of the vertices from the closed form in metres.
    """
    model = chain_model(joints)
    turns = np.tile([0, 0, angle], (joints, 1))
    parameters = HeadParameters(
        rotation=turns[0],
        translation=np.array([0.5, -2, 1]),
        joints=turns[1:],
        shape=np.zeros(0),
        expression=np.zeros(2),
    )
    directions = np.exp(1j * angle * np.arange(1, joints + 1))
    places = np.concatenate([[0], np.cumsum(directions)])
    places = np.append(places, places[-1] + 1j * directions[-1])
    expected = np.column_stack([places.real, places.imag, np.zeros(len(places))]) + parameters.translation
    yield difference("vertices", pose(model, parameters), expected, 1e-13 * joints**2)


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


def broken_pose(changes: dict[str, np.ndarray]) -> list[Measure]:
    """Parameters that are too large, not finite or of another model.

    Args:
        changes: Changed parameters.

    Returns:
        Nothing: they are an error.
    """
    usual = {"joints": np.zeros((2, 3)), "shape": np.zeros(0), "expression": np.zeros(2)}
    pose(chain_model(3), HeadParameters(**{**usual, **changes}))
    return []


if __name__ == "__main__":
    run(lambda: run_suite(__doc__, "rig", cases()))
