"""Surfels: skinning, its gradient, colours, and the initial surfels."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from carigs.mesh.carried_points import CarriedPoints
from carigs.settings import Train
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.colour.spherical_harmonics import SH_BASE, num_coefficients
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import ATTRIBUTES, Surfels, flat_discs, to_arrays
from carigs.splat.training.initial_surfels.initialization import place


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    return np.asarray(mesh.vertices) * [1.0, 1.3, 0.8], np.asarray(mesh.faces)


def random_surfels(n: int, faces: int, seed: int = 0) -> Surfels:
    rng = np.random.default_rng(seed)
    surfels = flat_discs(
        rng.integers(0, faces, n), rng.normal(size=(n, 3)), rng.random(n) + 0.2, 0.7, rng.random((n, 3))
    )
    for _, value in surfels.attributes():
        value.data += torch.from_numpy(rng.normal(size=tuple(value.shape)) * 0.5).float()
    return surfels


def bent(vertices):
    """A smooth non-rigid motion."""
    x, y, z = vertices.T
    angle = 6 * y
    return np.stack(
        [x * np.cos(angle) - z * np.sin(angle), 1.2 * y, x * np.sin(angle) + z * np.cos(angle) + x * x], axis=1
    )


def test_affine_motion_is_carried_exactly_with_any_blend_weights(ball):
    """All triangles share U and P, so blending them changes nothing: centre and tangents move by the affine map."""
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    surfels = random_surfels(300, len(faces))
    similarity = 1.3 * Rotation.from_rotvec([0.5, -2.5, 0.4]).as_matrix()
    rest = jacobian_blend_skinning(surfels, rig, face_motion(rig, vertices))
    moved = jacobian_blend_skinning(surfels, rig, face_motion(rig, vertices @ similarity.T + [0.1, 0.2, 0.3]))
    expected = rest.centre.detach().numpy() @ similarity.T + [0.1, 0.2, 0.3]
    np.testing.assert_allclose(moved.centre.detach().numpy(), expected, atol=2e-6)
    for name in ("tangent_u", "tangent_v"):
        expected = getattr(rest, name).detach().numpy() @ similarity.T
        np.testing.assert_allclose(getattr(moved, name).detach().numpy(), expected, atol=2e-6)


def test_at_rest_a_surfel_lies_where_its_triangle_puts_it(ball):
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    surfels = flat_discs(np.array([7]), np.array([[0.2, -0.1, 0.5]]), np.array([0.4]), 0.8, np.array([[0.1, 0.5, 0.9]]))
    world = jacobian_blend_skinning(surfels, rig, face_motion(rig, vertices))
    corners = vertices[faces[7]]
    edge = corners[1] - corners[0]
    normal = np.cross(edge, corners[2] - corners[0])
    edge, normal = edge / np.linalg.norm(edge), normal / np.linalg.norm(normal)
    towards = np.cross(normal, edge)
    k = (np.linalg.norm(corners[1] - corners[0]) + towards @ (corners[2] - corners[0])) / 2
    centre = corners.mean(axis=0) + k * (0.2 * edge - 0.1 * towards + 0.5 * normal)
    np.testing.assert_allclose(world.centre[0].detach().numpy(), centre, atol=1e-7)
    np.testing.assert_allclose(world.tangent_u[0].detach().numpy(), 0.4 * k * edge, atol=1e-7)
    np.testing.assert_allclose(world.tangent_v[0].detach().numpy(), 0.4 * k * towards, atol=1e-7)
    assert world.opacity.item() == pytest.approx(0.8)
    colour = seen_colour(surfels.colour, surfels.harmonics, None, None, surfels.binding)
    np.testing.assert_allclose(colour[0].detach().numpy(), [0.1, 0.5, 0.9], atol=1e-6)


def test_without_blending_only_the_own_jacobian_acts(ball):
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    motion = face_motion(rig, bent(vertices))
    surfels = random_surfels(200, len(faces))
    world = jacobian_blend_skinning(surfels, rig, motion, blend=False)
    local = np.einsum("nij,nj->ni", rig.frame[surfels.binding], surfels.position.detach().numpy())
    expected = motion.centre[surfels.binding] + np.einsum("nij,nj->ni", motion.jacobian[surfels.binding], local)
    np.testing.assert_allclose(world.centre.detach().numpy(), expected, atol=2e-6)


def test_blending_follows_the_formula(ball):
    """Compare with scipy's rotation vectors: J_b = U exp(sum v_i log(U^T U_i)) sum v_i P_i."""
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    motion = face_motion(rig, bent(vertices))
    surfels = random_surfels(100, len(faces))
    eye = np.array([0.1, -0.2, 1.0])
    world = jacobian_blend_skinning(surfels, rig, motion, eye=eye)
    weight = 1 / (1 + np.exp(-surfels.blend.detach().numpy().astype(float)))
    weight /= weight.sum(axis=1, keepdims=True)
    around = np.concatenate([surfels.binding[:, None], rig.neighbours[surfels.binding]], axis=1)
    own = Rotation.from_matrix(motion.rotation[surfels.binding])
    vector = sum(
        weight[:, [i]] * (own.inv() * Rotation.from_matrix(motion.rotation[around[:, i]])).as_rotvec() for i in range(4)
    )
    stretch = motion.stretch[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    rotation = (own * Rotation.from_rotvec(vector)).as_matrix()
    jacobian = rotation @ np.einsum("ns,nsij->nij", weight, stretch[around])
    local = np.einsum("nij,nj->ni", rig.frame[surfels.binding], surfels.position.detach().numpy())
    expected = motion.centre[surfels.binding] + np.einsum("nij,nj->ni", jacobian, local)
    np.testing.assert_allclose(world.centre.detach().numpy(), expected, atol=3e-6)
    away = expected - eye
    seen = np.einsum("nji,nj->ni", rotation, away / np.linalg.norm(away, axis=1, keepdims=True))
    np.testing.assert_allclose(world.direction.detach().numpy(), seen, atol=3e-6)


def test_surfels_that_keep_their_size_turn_and_move_without_stretch(ball):
    """With the own motion alone: tangents U K r s, centres as those of other surfels."""
    vertices, faces = ball
    free, inside = build_rig(vertices, faces), np.arange(len(faces)) % 2 == 0
    kept, surfels = free.with_kept_size(inside), random_surfels(200, len(faces))
    np.testing.assert_array_equal(kept.keeps_size, inside)
    motion = face_motion(kept, bent(vertices))
    world, other = (jacobian_blend_skinning(surfels, rig, motion, blend=False) for rig in (kept, free))
    rest = jacobian_blend_skinning(surfels, kept, face_motion(kept, vertices), blend=False)
    torch.testing.assert_close(world.centre, other.centre, rtol=0, atol=0)
    mine = inside[surfels.binding]
    turn = motion.rotation[surfels.binding]
    for name in ("tangent_u", "tangent_v"):
        found, before, stretched = (getattr(each, name).detach().numpy() for each in (world, rest, other))
        np.testing.assert_allclose(found[mine], np.einsum("nij,nj->ni", turn, before)[mine], atol=1e-6)
        np.testing.assert_array_equal(found[~mine], stretched[~mine])


@pytest.mark.parametrize("blend", [True, False])
@pytest.mark.parametrize("rotate", [True, False])
def test_gradients_are_those_of_finite_differences(ball, blend, rotate):
    """Gradients with respect to the surfels and to each number of the motion of the triangles."""
    vertices, faces = ball
    rig = build_rig(vertices, faces).with_kept_size(np.arange(len(faces)) % 2 == 0)
    rows = torch.from_numpy(face_motion(rig, bent(vertices)).records).double().requires_grad_(True)
    surfels = random_surfels(5, len(faces))
    names = [name for name in ATTRIBUTES if name not in ("colour", "harmonics")]
    leaves = [getattr(surfels, name).detach().double().requires_grad_(True) for name in names]
    used = np.unique([surfels.binding, *rig.neighbours[surfels.binding].T])

    def outputs(some, *values):
        doubled = replace(surfels, **dict(zip(names, values, strict=True)))
        motion = FaceMotion(rows.detach().index_put((torch.from_numpy(used),), some))
        return jacobian_blend_skinning(
            doubled, rig, motion, blend=blend, eye=np.array([0.1, -0.2, 1.0]), rotate_directions=rotate
        )

    some = rows.detach()[used].requires_grad_(True)
    assert torch.autograd.gradcheck(outputs, [some, *leaves], eps=1e-6, atol=1e-8, rtol=1e-5)


@pytest.mark.parametrize("blend", [True, False])
@pytest.mark.parametrize("rotate", [True, False])
def test_sixteen_at_a_time_is_the_same_as_one_by_one(ball, blend, rotate):
    """Vector code computes float32, scalar code float64. 1001 is not a multiple of 16."""
    vertices, faces = ball
    rig = build_rig(vertices, faces).with_kept_size(np.arange(len(faces)) % 2 == 0)
    records = torch.from_numpy(face_motion(rig, bent(vertices)).records)
    surfels = random_surfels(1001, len(faces))
    doubled = Surfels(
        **{name: value.detach().double().requires_grad_(True) for name, value in surfels.attributes()},
        binding=surfels.binding,
    )
    results = []
    for some in (surfels, doubled):
        rows = records.to(some.position.dtype, copy=True).requires_grad_(True)
        world = jacobian_blend_skinning(
            some, rig, FaceMotion(rows), blend=blend, eye=np.array([0.1, -0.2, 1.0]), rotate_directions=rotate
        )
        generator = torch.Generator().manual_seed(1)
        upstream = [torch.randn(t.shape, generator=generator).to(t.dtype) for t in world]
        for values in upstream:
            values[:7] = 0  # of surfels that no pixel shows
        torch.autograd.backward(world, upstream)
        gradients = [rows.grad, *(v.grad for n, v in some.attributes() if n not in ("colour", "harmonics"))]
        results.append(([t.detach() for t in world], gradients))
    for single, double in zip(*(values for values, _ in results), strict=True):
        torch.testing.assert_close(single.double(), double.double(), rtol=1e-5, atol=1e-6)
    for single, double in zip(*(gradients for _, gradients in results), strict=True):
        torch.testing.assert_close(single.double(), double, rtol=1e-4, atol=1e-6 * double.abs().max().item())


def test_gradients_do_not_depend_on_the_number_of_threads(ball):
    import numba

    vertices, faces = ball
    rig = build_rig(vertices, faces)
    motion = face_motion(rig, bent(vertices))
    seen = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        surfels = random_surfels(1001, len(faces))
        world = jacobian_blend_skinning(surfels, rig, motion)
        torch.autograd.backward(world[:4], [torch.ones_like(t) for t in world[:4]])
        seen.append(
            b"".join(v.grad.numpy().tobytes() for v in (v for _, v in surfels.attributes()) if v.grad is not None)
        )
    assert seen[0] == seen[1]


def test_harmonics_are_orthonormal():
    """Gauss-Legendre nodes in z and equal steps in azimuth integrate the products, of degree 6, exactly."""
    z, weight = np.polynomial.legendre.leggauss(8)
    angle = 2 * np.pi * np.arange(16) / 16
    r = np.sqrt(1 - z * z)[:, None]
    direction = np.stack([r * np.cos(angle), r * np.sin(angle), np.broadcast_to(z[:, None], (8, 16))], axis=2).reshape(
        -1, 3
    )
    values = np.empty((len(direction), num_coefficients(3)))
    for k in range(num_coefficients(3)):  # each function alone, in red
        one = torch.zeros(len(direction), num_coefficients(3), 3, dtype=torch.float64)
        one[:, k, 0] = 1
        grey = torch.full((len(direction), 3), 8.0, dtype=torch.float64)  # no colour is clamped
        colour = seen_colour(grey, one, torch.from_numpy(direction), None, np.zeros(len(direction), np.int32))
        values[:, k] = colour[:, 0].numpy() - 0.5 - 8.0 * SH_BASE
    gram = np.einsum("n,ni,nj->ij", np.repeat(weight, 16) * 2 * np.pi / 16, values, values)
    np.testing.assert_allclose(gram, np.eye(num_coefficients(3)), atol=1e-12)


def test_directions_are_the_same_when_head_and_eye_turn_together(ball):
    """View-dependent colour therefore turns with the head."""
    vertices, faces = ball
    rig, surfels, eye = build_rig(vertices, faces), random_surfels(50, len(faces)), np.array([0.0, 0.3, 0.4])
    turn = Rotation.from_rotvec([0.3, 1.2, -0.5]).as_matrix()
    still = jacobian_blend_skinning(surfels, rig, face_motion(rig, bent(vertices)), eye=eye)
    turned = jacobian_blend_skinning(surfels, rig, face_motion(rig, bent(vertices) @ turn.T), eye=turn @ eye)
    torch.testing.assert_close(turned.direction, still.direction, rtol=0, atol=5e-6)


@pytest.mark.parametrize("lit", [True, False])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_gradients_of_the_colour_are_those_of_finite_differences_in_vectors_too(degree, lit):
    """About half of the colours are negative before they are clamped to 0."""
    rng = np.random.default_rng(degree)
    sizes = [(37, 3), (37, num_coefficients(degree), 3), (37, 3)][: 3 if degree else 1]
    double = [torch.from_numpy(rng.normal(-0.3, 1.5, size)).requires_grad_(True) for size in sizes]
    shade = rng.uniform(0.5, 1.5, (7, 3)).astype(np.float32) if lit else None
    binding = rng.integers(0, 7, 37).astype(np.int32)

    def colour(base, harmonics=None, direction=None):
        harmonics = base.new_empty(len(base), 0, 3) if harmonics is None else harmonics
        return seen_colour(base, harmonics, direction, shade, binding[: len(base)])

    assert torch.autograd.gradcheck(colour, [leaf[:5].detach().requires_grad_(True) for leaf in double], atol=1e-7)
    single = [leaf.detach().float().requires_grad_(True) for leaf in double]
    seen, expected = colour(*single), colour(*double)
    assert 0.1 < (expected == 0).float().mean() < 0.9
    torch.testing.assert_close(seen.double(), expected, rtol=1e-5, atol=1e-4)
    upstream = torch.from_numpy(rng.normal(size=(37, 3)))
    expected.backward(upstream)
    seen.backward(upstream.float())
    for a, b in zip(single, double, strict=True):
        torch.testing.assert_close(a.grad.double(), b.grad, rtol=1e-4, atol=1e-4)


def test_first_surfels_lie_in_their_triangles_and_those_of_hair_at_its_points(ball):
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(50, 3, 2)))[0]
    elongation = rng.uniform(1, 6, 50)
    hair = CarriedPoints(
        rng.integers(0, len(faces), 50), 0.2 * rng.normal(size=(50, 3)), np.full(50, 0.004), axes, elongation
    )
    binding, position, scale, rotation = place(Train(surfels_per_face=4), rig, [hair])
    assert len(binding) == 4 * len(faces) + 50
    np.testing.assert_array_equal(binding[4 * len(faces) :], hair.face)
    size = scale[4 * len(faces) :] * rig.scale[hair.face, None]
    np.testing.assert_allclose(size[:, 0] * size[:, 1], 0.0016**2)  # a disc of 0.4 spacings, stretched at equal area
    np.testing.assert_allclose(size[:, 0] / size[:, 1], elongation)
    local = Rotation.from_quat(rotation[4 * len(faces) :], scalar_first=True).as_matrix()
    turned = rig.frame[hair.face] @ local[..., :2] / rig.scale[hair.face, None, None]
    np.testing.assert_allclose(turned, axes, atol=1e-6)
    point = np.einsum("nij,nj->ni", rig.frame[binding], position)  # relative to the centroid, in metres
    corners = vertices[faces[binding]] - vertices[faces[binding]].mean(axis=1, keepdims=True)
    normal = rig.frame[binding, :, 2] / rig.scale[binding, None]
    height = np.einsum("nc,nc->n", point, normal)
    on_skin = np.arange(len(binding)) < 4 * len(faces)
    np.testing.assert_allclose(height[on_skin], 0, atol=1e-7)
    centre = vertices[faces[binding]].mean(axis=1)
    np.testing.assert_allclose((centre + point)[~on_skin], hair.position, atol=1e-6)
    solved = np.linalg.solve(np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], normal], 2),
                             (point - corners[:, 0])[..., None])[on_skin, :2, 0]  # fmt: skip
    assert solved.min() > -1e-5
    assert solved.sum(axis=1).max() < 1 + 1e-5


def test_surfels_are_sorted_by_triangle_with_their_attributes():
    surfels = flat_discs(
        np.array([3, 1, 2]), np.diag([1.0, 2, 3]), np.ones(3), 0.5, np.diag([0.3, 0.6, 0.9]), sh_degree=2
    )
    np.testing.assert_array_equal(surfels.binding, [1, 2, 3])
    np.testing.assert_array_equal(surfels.position.detach().numpy(), [[0, 2, 0], [0, 0, 3], [1, 0, 0]])
    assert surfels.sh_degree == 2
    assert set(to_arrays(surfels)) == {*ATTRIBUTES, "binding"}
