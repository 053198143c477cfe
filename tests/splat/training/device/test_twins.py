"""The PyTorch twins against the Numba kernels: values to 1e-5, gradients to 1e-4, relative to the largest entry."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from carigs.capture import Camera, look_at
from carigs.hair import SpaceAboveSkin
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.rasterizer.interface import Screen
from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.rig.smooth_motion import SmoothMotion
from carigs.splat.surfels.surfels import flat_discs
from carigs.splat.training.adam import Adam
from carigs.splat.training.density import GradientStatistics
from carigs.splat.training.device import colour, skinning
from carigs.splat.training.device.adam import DeviceAdam
from carigs.splat.training.device.hair_rules import HairRules
from carigs.splat.training.device.mesh import device_mesh
from carigs.splat.training.device.photometric_loss import photometric_loss as device_photometric_loss
from carigs.splat.training.device.statistics import DeviceStatistics
from carigs.splat.training.device.threshold_loss import threshold_loss
from carigs.splat.training.initial_surfels.hair_surfels import HairSurfels
from carigs.splat.training.photometric_loss import photometric_loss
from carigs.splat.training.regularizers import add_threshold_loss

CPU = torch.device("cpu")
EYE = np.array([0.1, -0.2, 0.6])


def distance(found, expected):
    """Largest difference over the largest entry."""
    return float((found - expected).abs().max() / expected.abs().max().clamp_min(1e-30))


@pytest.fixture(scope="module")
def rig():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    return build_rig(mesh.vertices * [1.0, 1.3, 0.8], mesh.faces).with_kept_size(np.arange(len(mesh.faces)) % 3 == 0)


def random_surfels(rig, seed, degree=0, per_face=2):
    rng = np.random.default_rng(seed)
    n = per_face * len(rig.faces)
    binding = np.tile(np.arange(len(rig.faces)), per_face)
    surfels = flat_discs(binding, 0.4 * rng.normal(size=(n, 3)), 0.4 * np.exp(0.4 * rng.normal(size=(n, 2))),
                         rng.uniform(0.05, 0.95, n), rng.random((n, 3)), degree, rng.normal(size=(n, 4)))  # fmt: skip
    with torch.no_grad():
        surfels.blend += torch.from_numpy(rng.normal(size=(n, 4)).astype(np.float32))
        surfels.harmonics += torch.from_numpy(0.3 * rng.normal(size=surfels.harmonics.shape).astype(np.float32))
    return surfels


def bent(rig, smooth=False):
    """The mesh bent, stretched and turned by almost pi; with averaged rotations on its upper half if asked for."""
    vertices = rig.vertices * [1.3, 0.9, 1.1]
    turn = Rotation.from_rotvec(np.outer(4 * vertices[:, 1], [0.3, 2.0, 0.5]))
    posed = Rotation.from_rotvec([0.2, 3.0, -0.1]).apply(turn.apply(vertices)) + 0.02
    upper = rig.vertices[rig.faces].mean(axis=1)[:, 1] > 0.03
    return face_motion(rig, posed, SmoothMotion(rig, upper, grows=True).apply if smooth else None)


def functional(tensors, seed=3):
    generator = torch.Generator().manual_seed(seed)
    return sum((t * torch.randn(t.shape, generator=generator)).sum() for t in tensors if t is not None)


@pytest.mark.parametrize("eye", [None, EYE], ids=["no eye", "eye"])
@pytest.mark.parametrize("blend", [True, False], ids=["jbs", "jacobian"])
@pytest.mark.parametrize("smooth", [False, True], ids=["mesh", "hair"])
def test_skinning(rig, smooth, blend, eye):
    surfels, motion = random_surfels(rig, 1), bent(rig, smooth)
    twin, binding = surfels.detached(), torch.from_numpy(surfels.binding).long()
    expected = jacobian_blend_skinning(surfels, rig, motion, blend=blend, eye=eye)
    records = torch.from_numpy(motion.records)
    found = skinning.skin(twin, binding, device_mesh(rig, CPU), records, blend=blend, eye=eye)
    for a, b in zip(found, expected, strict=True):
        assert (a is None) == (b is None)
        assert a is None or distance(a.detach(), b.detach()) < 1e-5
    functional(found).backward()
    functional(expected).backward()
    for name in ("position", "rotation", "log_scale", "opacity", *(("blend",) if blend else ())):
        assert distance(getattr(twin, name).grad, getattr(surfels, name).grad) < 1e-4, name


def test_gradients_of_skinning_with_respect_to_the_motion(rig):
    """What the refinement of the tracking needs."""
    surfels, motion, gradients = random_surfels(rig, 2), bent(rig), []
    for skin in (
        lambda m: jacobian_blend_skinning(surfels, rig, SimpleNamespace(records=m), eye=EYE),
        lambda m: skinning.skin(surfels, torch.from_numpy(surfels.binding).long(), device_mesh(rig, CPU), m, eye=EYE),
    ):
        records = torch.from_numpy(motion.records).requires_grad_(True)
        functional(skin(records)).backward()
        gradients.append(records.grad)
    assert distance(gradients[1], gradients[0]) < 1e-4


def test_skinning_of_quaternions_of_any_length(rig):
    surfels = random_surfels(rig, 3)
    scale = torch.tensor([1e-25, 1e-6, 1.0, 1e6, 1e25]).repeat(len(surfels) // 5)[:, None]
    n, mesh = len(scale), device_mesh(rig, CPU)
    axes = skinning.disc_axes(surfels.rotation.detach()[:n])
    torch.testing.assert_close(skinning.disc_axes(surfels.rotation.detach()[:n] * scale), axes, atol=1e-6, rtol=0)
    assert torch.equal(skinning.disc_axes(torch.zeros(1, 4))[0], torch.eye(3)[:, :2])
    assert mesh.frame.isfinite().all()


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("lit", [False, True])
def test_colours(rig, degree, lit):
    rng, surfels = np.random.default_rng(degree), random_surfels(rig, 4, degree)
    shade = rng.uniform(0.3, 1.5, (len(rig.faces), 3)).astype(np.float32) if lit else None
    factor = torch.from_numpy(shade[surfels.binding]) if lit else None
    direction = rng.normal(size=(len(surfels), 3))
    direction = torch.from_numpy(direction / np.linalg.norm(direction, axis=1, keepdims=True)).float()
    results = []
    for see in (lambda *t: seen_colour(*t, shade, surfels.binding), lambda *t: colour.seen_colour(*t, factor)):
        leaves = [2 * surfels.colour.detach(), surfels.harmonics.detach(), direction if degree else None]
        leaves = [None if t is None else t.clone().requires_grad_(True) for t in leaves]
        image = see(*leaves)
        functional([image]).backward()
        results.append((image.detach(), [t.grad for t in leaves if t is not None and t.numel()]))
    (expected, expected_gradients), (found, gradients) = results
    assert (expected == 0).any()  # some are clamped
    assert distance(found, expected) < 1e-5
    assert all(distance(a, b) < 1e-4 for a, b in zip(gradients, expected_gradients, strict=True))


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_photometric_loss(masked, weight):
    generator = torch.Generator().manual_seed(5)
    y, x = torch.meshgrid(torch.linspace(0, 1, 67), torch.linspace(0, 1, 45), indexing="ij")
    target = torch.stack([x, y, 0.5 * (x + y)], dim=2) * 0.8 + 0.1 * torch.rand(67, 45, 3, generator=generator)
    image = (0.9 * target + 0.1 * torch.rand(67, 45, 3, generator=generator)).requires_grad_(True)
    twin = image.detach().clone().requires_grad_(True)
    valid = torch.rand(67, 45, generator=generator) > 0.3 if masked else None
    expected, found = (
        photometric_loss(image, target, weight, valid),
        device_photometric_loss(twin, target, weight, valid),
    )
    assert found.item() == pytest.approx(expected.item(), rel=1e-5)
    found.backward()
    expected.backward()
    assert distance(twin.grad, image.grad) < 1e-4
    assert valid is None or (twin.grad[~valid] == 0).all()


def test_threshold_losses(rig):
    surfels, rng = random_surfels(rig, 6), np.random.default_rng(6)
    with torch.no_grad():
        surfels.position[:5], surfels.log_scale[5:9] = 0, -40
    seen, limit = rng.random(len(surfels)) < 0.7, 0.3 + 0.5 * rng.random(len(surfels))
    twin = surfels.detached()
    surfels.position.grad, surfels.log_scale.grad = torch.zeros(len(surfels), 3), torch.zeros(len(surfels), 2)
    expected = add_threshold_loss(surfels, seen, limit, 0.01, 0.4, 2.0)
    with torch.no_grad():
        twin.position[~torch.from_numpy(seen)] = torch.nan
    found = threshold_loss(twin, torch.from_numpy(seen), torch.from_numpy(limit).float(), 0.01, 0.4, 2.0)
    assert found.item() == pytest.approx(expected, rel=1e-5)
    found.backward()
    assert distance(twin.position.grad, surfels.position.grad) < 1e-4
    assert distance(twin.log_scale.grad, surfels.log_scale.grad) < 1e-4
    assert threshold_loss(twin, torch.zeros(len(twin), dtype=torch.bool), torch.ones(len(twin)), 1, 0, 1).item() == 0


def test_adam_with_frozen_rows_and_new_ones(rig):
    rng = np.random.default_rng(7)
    surfels = random_surfels(rig, 7, degree=1)
    twin = surfels.detached()
    host, device = Adam(surfels), DeviceAdam(twin)
    rates = {name: 0.01 * (k + 1) for k, (name, _) in enumerate(surfels.attributes())}
    for step in range(6):
        frozen = rng.random(len(surfels)) < 0.3 if step % 2 else None
        for (_, a), (_, b) in zip(surfels.attributes(), twin.attributes(), strict=True):
            a.grad = torch.from_numpy(rng.normal(size=tuple(a.shape)).astype(np.float32))
            b.grad = a.grad.clone()
        before = {name: value.detach().clone() for name, value in twin.attributes()}
        host.step(surfels, rates, frozen)
        device.step(twin, rates, None if frozen is None else torch.from_numpy(frozen))
        if frozen is not None:
            assert all(torch.equal(value[frozen], before[name][frozen]) for name, value in twin.attributes())
    for (name, a), (_, b) in zip(surfels.attributes(), twin.attributes(), strict=True):
        assert distance(b.detach(), a.detach()) < 1e-5, name
    source = rng.integers(0, len(surfels), 30)
    new = rng.random(30) < 0.4
    host.reorder(source, new)
    device.reorder(source, new)
    expected, found = host.as_arrays(), device.as_arrays()
    assert list(found) == list(expected)
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-5, atol=1e-7)
        assert (found[name][new] == 0).all()


def test_gradient_statistics():
    camera = Camera(look_at(np.array([0, 0, 1.0]), np.zeros(3)), 60, 60, 20, 15, 40, 30)
    host, generator = GradientStatistics(50), torch.Generator().manual_seed(0)
    device = DeviceStatistics(GradientStatistics(50), CPU)
    for _ in range(3):
        seen = torch.rand(50, generator=generator) < 0.6
        screen = Screen(seen, torch.randn(50, 2, generator=generator))
        screen.gradient[~seen] = torch.nan
        host.add(screen, camera)
        device.add(screen, camera)
    np.testing.assert_array_equal(device.views, host.views)
    np.testing.assert_allclose(device.mean(), host.mean(), rtol=1e-6)


def test_rules_for_hair(rig):
    rng, f = np.random.default_rng(8), len(rig.faces)
    height = rig.vertices[rig.faces].mean(axis=1)[:, 1]
    scalp, covered = height > 0.06, (height > 0.02) & (height <= 0.06)
    space = SpaceAboveSkin(rig.vertices, rig.faces, ~(scalp | covered))
    hair = HairSurfels(None, scalp, covered, covered & (rng.random(f) < 0.5), ~(scalp | covered), space, np.zeros(f))
    surfels = random_surfels(rig, 9, degree=1)
    surfels.position.data *= 3  # so that some of the scalp's reach over bare skin
    surfels.position.data[np.flatnonzero(scalp[surfels.binding])[:40]] *= 4
    twin, rules = surfels.detached(), HairRules(hair, device_mesh(rig, CPU), CPU)
    binding = torch.from_numpy(surfels.binding).long()
    for each in (surfels, twin):
        for _, value in each.attributes():
            value.grad = torch.ones_like(value)
    hair.keep_hidden_skin(surfels)
    rules.keep_hidden_skin(twin, binding)
    before = surfels.opacity.detach().clone()
    hair.fade_over_bare_skin(surfels, rig)
    rules.fade_over_bare_skin(twin, binding)
    assert (surfels.opacity != before).any() and (surfels.opacity == before).any()
    hair.keep_on_covered_skin(surfels)
    rules.keep_on_covered_skin(twin, binding)
    for (name, a), (_, b) in zip(surfels.attributes(), twin.attributes(), strict=True):
        torch.testing.assert_close(b, a, rtol=1e-6, atol=1e-7, msg=name)
        assert torch.equal(a.grad, b.grad), name
