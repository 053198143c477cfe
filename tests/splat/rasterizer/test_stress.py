"""The rasterizer and the rig on extreme and degenerate input.

Hypothesis draws lists of kinds of degenerate input, so that a failing example shrinks to the kinds that cause it.
"""

from dataclasses import replace

import numba
import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from stress.surfel_gradients import agreement, defined, loss, measured
from stress.surfel_scenes import CAMERA, KINDS, THICK, scene

from carigs.errors import CarigsError
from carigs.simd.vectors import WIDTH
from carigs.splat.render import render
from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import flat_discs

seeds = st.integers(0, 2**32 - 1)
thick_kinds = st.lists(st.sampled_from([*THICK]), min_size=8, max_size=20)
any_kinds = st.lists(st.sampled_from([*KINDS, "regular"]), min_size=8, max_size=20)


@given(any_kinds, seeds)
def test_extreme_scenes_are_drawn_and_differentiated_as_defined(kinds, seed):
    """To 1e-4, or for images thinner than a float32 spacing of pixel positions to the effect of that spacing."""
    assert [measure for measure in agreement(scene(kinds, seed)) if not measure.holds] == []


@given(any_kinds, seeds)
@settings(max_examples=15)
def test_the_torch_backend_draws_extreme_scenes_as_defined(kinds, seed):
    assert [measure for measure in agreement(scene(kinds, seed), backend="torch") if not measure.holds] == []


@pytest.mark.xfail(
    strict=True,
    reason="the backward's S = Q - sum w q cancels: behind layers with transmittance T the relative error is ~1e-7 / T",
)
def test_gradients_behind_nearly_closed_layers_are_exact():
    """Two discs cover the image and leave 2e-4 of the light to ten regular ones."""
    arrays = scene(["regular"] * 12, 0)
    arrays[0][:2] = [[0, 0, 0.5], [0, 0, 0.6]]
    arrays[1][:2], arrays[2][:2] = [1e3, 0, 0], [0, 1e3, 0]
    arrays[3][:2] = 0.985
    expected, clear = defined(arrays)
    assert clear.all()
    found = measured(arrays)
    pairs = zip(found.gradients, expected.gradients, strict=True)
    errors = [((f - e).norm() / e.norm()).item() for f, e in pairs]
    assert max(errors) < 1e-4, errors


def same_bytes(first, second):
    return all(a.numpy().tobytes() == b.numpy().tobytes() for a, b in zip(first, second, strict=True))


# Scalar code projects fewer than 16 surfels, vector code 16 and more: their rounding differs.
@given(
    st.lists(st.sampled_from([*KINDS, "regular"]), min_size=1, max_size=40).filter(lambda kinds: len(kinds) != WIDTH),
    seeds,
    st.sampled_from(range(5)),
    st.sampled_from([np.nan, np.inf, -np.inf]),
)
def test_a_surfel_that_is_not_finite_is_as_if_it_were_not_there(kinds, seed, field, value):
    arrays, random = scene(kinds, seed), np.random.default_rng(seed)
    bad = random.integers(len(kinds))
    arrays[field].reshape(len(kinds), -1)[bad, random.integers(arrays[field][0].size)] = value
    others = np.arange(len(kinds)) != bad
    images, gradients = measured(arrays)
    images_without, gradients_without = measured([array[others] for array in arrays])
    assert all(image.isfinite().all() for image in images)
    assert same_bytes(images, images_without)
    assert same_bytes([g[others] for g in gradients], gradients_without)
    assert all((g[bad] == 0).all() for g in gradients)


@pytest.mark.parametrize("count", [3, 20])
@pytest.mark.parametrize("field", range(3))
@pytest.mark.parametrize("size", [1e6, 1e10, 1e20, 1e30, 1e38])
def test_numbers_near_the_end_of_float32_leave_everything_finite(size, field, count):
    arrays = scene(["regular"] * count, 5)
    arrays[field][1] = [size, 0, 0]
    arrays[field][2] = [0.3 * size, size, 0]
    images, gradients = measured(arrays)
    assert all(values.isfinite().all() for values in (*images, *gradients))


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one thread")
@given(st.lists(st.sampled_from([*KINDS, "regular"]), min_size=40, max_size=200), seeds)
@settings(max_examples=10)
def test_extreme_scenes_are_the_same_bytes_at_any_number_of_threads(kinds, seed):
    arrays, results, before = scene(kinds, seed), [], numba.get_num_threads()
    camera = replace(CAMERA.scaled(4), width=131, height=107)
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            results.append(measured(arrays, camera))
    finally:
        numba.set_num_threads(before)
    assert same_bytes(results[0][0] + results[0][1], results[1][0] + results[1][1])


def assert_as_plain(arrays, camera):
    """Compare vector code with plain loops where both blend the same surfels (else alpha differs by 1/255)."""
    alpha = [measured(arrays, camera, backend=backend)[0][1] for backend in ("cpu", "scalar")]
    same = (alpha[0] - alpha[1]).abs() < 1e-5
    assert same.float().mean() > 0.98
    found, expected = (measured(arrays, camera, same, backend) for backend in ("cpu", "scalar"))
    for a, b in zip(found[0] + found[1], expected[0] + expected[1], strict=True):
        assert a.shape == b.shape
        assert (a - b).norm() <= 1e-4 * b.norm()


@pytest.mark.parametrize("count", range(41))
def test_any_number_of_surfels_is_drawn_as_by_plain_loops(count):
    """The kernels take 16 surfels at a time, where the last 16 may overlap the others, and fewer than 16 one by one."""
    assert_as_plain(scene(["regular"] * count, count), CAMERA)


@given(st.integers(1, 70), st.integers(1, 45), thick_kinds, seeds)
def test_images_of_any_size_are_those_of_plain_loops(width, height, kinds, seed):
    camera = replace(CAMERA, width=width, height=height, cx=0.49 * width, cy=0.52 * height)
    assert_as_plain(scene(kinds, seed), camera)


@given(st.integers(1, 70), st.integers(1, 45), thick_kinds, seeds)
def test_a_smaller_image_is_the_corner_of_a_larger_one(width, height, kinds, seed):
    arrays = scene(kinds, seed)
    large = measured(arrays, replace(CAMERA, width=75, height=50))[0]
    small = measured(arrays, replace(CAMERA, width=width, height=height))[0]
    large = [image[:height, :width] for image in large]
    same = (large[1] - small[1]).abs() < 1e-4
    assert same.float().mean() > 0.98
    for a, b in zip(small, large, strict=True):
        torch.testing.assert_close(a[same], b[same], rtol=1e-3, atol=1e-4)


# Meshes.

BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
VERTICES, FACES = np.asarray(BALL.vertices) * [1.0, 1.3, 0.8], np.asarray(BALL.faces)


def flat(vertices, corners, random):
    """Put the third corner on the opposite edge."""
    vertices[corners[2]] = vertices[corners[:2]].mean(axis=0)


def folded(vertices, corners, random):
    """Put two vertices at one place."""
    vertices[corners[2]] = vertices[corners[0]]


def sliver(vertices, corners, random):
    """Give the triangle a height of about 1e-13 to 0.01 m."""
    a, b, c = corners
    vertices[c] = vertices[a] + random.random() * (vertices[b] - vertices[a])
    vertices[c] += 10 ** random.uniform(-12, -1) * 0.1 * random.normal(size=3)


def short(vertices, corners, random):
    """Shorten one edge by a factor of up to 1e14; the other two then have nearly equal lengths."""
    a, _, c = corners
    vertices[c] = vertices[a] + 10 ** random.uniform(-14, -1) * (vertices[c] - vertices[a])


def flipped(vertices, corners, random):
    """Move the third corner to the other side of the opposite edge."""
    a, b, c = corners
    vertices[c] = vertices[a] + vertices[b] - vertices[c]


DAMAGE = {change.__name__: change for change in (flat, folded, sliver, short, flipped)}
damage = st.lists(st.sampled_from([*DAMAGE]), max_size=8)
units = st.floats(-6, 6).map(lambda power: 10.0**power)


def damaged(kinds, random, faces=FACES):
    vertices = VERTICES.copy()
    for kind in kinds:
        DAMAGE[kind](vertices, np.roll(faces[random.integers(len(faces))], random.integers(3)), random)
    return vertices


def some_surfels(n, seed=0, sh_degree=0):
    random = np.random.default_rng(seed)
    binding = random.integers(0, len(FACES), n)
    position, colour = random.normal(size=(n, 3)), random.random((n, 3))
    surfels = flat_discs(binding, position, random.uniform(0.2, 1, n), 0.7, colour, sh_degree)
    for _, value in surfels.attributes():
        value.data += torch.from_numpy(random.normal(size=tuple(value.shape)) * 0.4).float()
    return surfels


def skinned(surfels, rig, motion, blend=True):
    """World surfels, and the gradients of a linear functional of them by attribute."""
    for _, value in surfels.attributes():
        value.grad = None
    world = jacobian_blend_skinning(surfels, rig, motion, blend=blend)[:4]
    loss(world).backward()
    gradients = {name: value.grad for name, value in surfels.attributes() if value.grad is not None}
    return [value.detach() for value in world], gradients


@given(damage, damage, units, units, st.booleans(), seeds)
def test_damaged_meshes_in_any_unit_carry_surfels_to_finite_places(canonical, posed, unit, other, blend, seed):
    random, faces = np.random.default_rng(seed), FACES.copy()
    odd = random.integers(len(faces))
    faces[odd, 2] = faces[odd, 1]  # a corner twice in one face
    rig = build_rig(damaged(canonical, random, faces) * unit, faces)
    motion = face_motion(rig, damaged(posed, random, faces) * other)
    assert all(np.isfinite(a).all() for a in (rig.scale, rig.frame, rig.inverse_edges, motion.records))
    turned = np.einsum("fji,fjk->fik", motion.rotation, motion.rotation)
    np.testing.assert_allclose(turned, np.broadcast_to(np.eye(3), turned.shape), atol=1e-5)
    assert np.linalg.det(motion.rotation).min() > 0.99
    stretch = np.linalg.eigvalsh(motion.stretch[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3).astype(float))
    assert (stretch[:, 0] >= -1e-6 * stretch[:, 2]).all()
    world, gradients = skinned(some_surfels(40, seed), rig, motion, blend)
    assert all(value.isfinite().all() for value in (*world, *gradients.values()))


@given(damage, units, seeds)
def test_a_rigid_motion_of_a_damaged_mesh_moves_surfels_rigidly(kinds, unit, seed):
    """Faces without area move like their neighbours."""
    random = np.random.default_rng(seed)
    turn, offset = Rotation.random(random_state=seed).as_matrix(), random.normal(size=3) * unit
    vertices = damaged(kinds, random) * unit
    rig = build_rig(vertices, FACES)
    sound = rig.inverse_edges.any(axis=(1, 2))
    # Rotated corners are rounded, and the height of a sliver may be no larger than that.
    height = 1 / np.abs(rig.inverse_edges[sound]).max()
    tolerance = 1e-5 + 1e-15 * (np.abs(vertices).max() + np.abs(offset).max()) / height
    surfels = some_surfels(40, seed)
    rest, _ = skinned(surfels, rig, face_motion(rig, vertices))
    moved, _ = skinned(surfels, rig, face_motion(rig, vertices @ turn.T + offset))
    for k, shift in ((0, offset), (1, 0), (2, 0)):
        expected = rest[k].numpy().astype(float) @ turn.T + shift
        size = np.abs(expected).max() + unit
        np.testing.assert_allclose(moved[k].numpy() / size, expected / size, rtol=0, atol=tolerance)


@given(damage, damage, st.integers(-20, 20), seeds)
def test_in_another_unit_everything_is_the_same_to_the_last_digit(canonical, posed, power, seed):
    """Scaling by a power of two is exact, so results differ only if some threshold is a length."""
    random, unit, seen = np.random.default_rng(seed), 2.0**power, []
    canonical, posed = damaged(canonical, random), damaged(posed, random)
    for scale in (1.0, unit):
        rig = build_rig(canonical * scale, FACES)
        motion = face_motion(rig, posed * scale)
        world, _ = skinned(some_surfels(40, seed), rig, motion)
        seen.append(
            [motion.rotation, motion.stretch, motion.relative_rotation, *(value.numpy() / scale for value in world[:3])]
        )
    for a, b in zip(*seen, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("where", ["canonical", "posed"])
def test_a_vertex_that_is_not_finite_is_an_error_that_names_it(where):
    broken = VERTICES.copy()
    broken[7, 1] = np.nan
    with pytest.raises(CarigsError, match="7"):
        face_motion(build_rig(broken if where == "canonical" else VERTICES, FACES), broken)


# Attributes.

FEW, MANY = 5, 20  # numbers of surfels for scalar and for vector code


@pytest.mark.parametrize(
    ("name", "value", "n"),
    [
        *((name, value, n) for name in ("opacity",) for value in (-1e4, 1e4) for n in (FEW, MANY)),
        *(("log_scale", value, n) for value in (-80, 80) for n in (FEW, MANY)),
        *(("rotation", value, n) for value in (0, 1e-20) for n in (FEW, MANY)),
        ("rotation", 1e20, FEW),
        ("rotation", 1e20, MANY),
        *(("blend", 1e4, n) for n in (FEW, MANY)),
        ("blend", -1e4, FEW),
        ("blend", -1e4, MANY),
    ],
)  # fmt: skip
def test_extreme_attributes_give_numbers_and_leave_other_surfels_alone(name, value, n):
    rig = build_rig(VERTICES, FACES)
    motion = face_motion(rig, damaged(["sliver", "flipped"], np.random.default_rng(0)))
    usual, extreme = some_surfels(n), some_surfels(n)
    getattr(extreme, name).data[3] = value
    (world, gradients), (expected, expected_gradients) = (skinned(s, rig, motion) for s in (extreme, usual))
    others = np.arange(n) != 3
    for a, b in zip((*world, *gradients.values()), (*expected, *expected_gradients.values()), strict=True):
        assert torch.equal(a[others], b[others])
        assert a.isfinite().all()


@pytest.mark.parametrize("n", [FEW, MANY])
def test_blend_weights_far_apart_are_zero_and_one(n):
    rig, surfels, own = build_rig(VERTICES, FACES), some_surfels(n), some_surfels(n)
    surfels.blend.data[:] = torch.tensor([1e4, -1e4, -1e4, -1e4])
    motion = face_motion(rig, damaged(["sliver", "flipped"], np.random.default_rng(0)))
    for a, b in zip(
        jacobian_blend_skinning(surfels, rig, motion)[:3],
        jacobian_blend_skinning(own, rig, motion, blend=False)[:3],
        strict=True,
    ):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-6)


HEAD_ON = replace(CAMERA, camera_from_world=np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.4], [0, 0, 0, 1]]))


def drawn(surfels):
    """Image, and gradients by attribute."""
    rig = build_rig(VERTICES, FACES)
    drawing = render(surfels, rig, face_motion(rig, VERTICES * [1.1, 0.9, 1.0]), HEAD_ON)
    loss([drawing.image]).backward()
    return drawing.image.detach(), {name: value.grad for name, value in surfels.attributes()}


def with_a_nan(name, n):
    """Surfels with a NaN in one, and the same where that one is invisible."""
    broken, hidden = some_surfels(n, sh_degree=2), some_surfels(n, sh_degree=2)
    getattr(broken, name).data[3].reshape(-1)[0] = np.nan
    hidden.opacity.data[3] = -20.0
    return drawn(broken), drawn(hidden)


@pytest.mark.parametrize(
    ("name", "n"),
    [
        *((name, n) for name in ("position", "rotation", "log_scale", "colour", "harmonics") for n in (FEW, MANY)),
        *((name, n) for name in ("opacity", "blend") for n in (FEW, MANY)),
    ],
)  # fmt: skip
def test_a_surfel_with_a_nan_is_not_drawn_and_leaves_other_surfels_alone(name, n):
    (image, gradients), (expected, expected_gradients) = with_a_nan(name, n)
    assert image.isfinite().all()
    assert torch.equal(image, expected)
    others = np.arange(n) != 3
    assert all(torch.equal(gradients[a][others], expected_gradients[a][others]) for a in gradients)


@pytest.mark.parametrize("n", [FEW, MANY])
@pytest.mark.parametrize("name", ["position", "rotation", "log_scale", "opacity", "colour", "harmonics", "blend"])
def test_a_surfel_with_a_nan_has_no_gradient_that_is_one(name, n):
    """It is not drawn, so its gradients are zero; a NaN would spread to its other attributes."""
    (_, gradients), _ = with_a_nan(name, n)
    assert all(gradient.isfinite().all() for gradient in gradients.values())
