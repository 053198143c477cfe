"""Density control: which surfels are cloned, split and pruned, and what their children inherit."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh

from carigs.capture import Camera
from carigs.settings import Density
from carigs.splat.rig.rig import build_rig
from carigs.splat.surfels.surfels import flat_discs, from_arrays, to_arrays
from carigs.splat.training.adam import Adam
from carigs.splat.training.density import (
    GradientStatistics,
    densify_and_prune,
    keep_one_per_face,
    reset_opacity,
    scene_extent,
)


@pytest.fixture(scope="module")
def rig():
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    return build_rig(mesh.vertices, mesh.faces)


def scene(rig, seed=0):
    """One surfel per face, and an optimiser whose moments identify the surfels."""
    n = len(rig.faces)
    rng = np.random.default_rng(seed)
    surfels = flat_discs(np.arange(n), 0.1 * rng.normal(size=(n, 3)), np.full(n, 0.4), 0.8, rng.random((n, 3)))
    adam = Adam(surfels)
    for moments in (adam.first, adam.second):
        for value in moments.values():
            value += (1 + np.arange(n, dtype=np.float32)).reshape(-1, *[1] * (value.ndim - 1))
    return surfels, adam


def run(surfels, adam, gradient, rig, extent=1.0, **settings):
    """Refine with the default threshold on the gradient."""
    return densify_and_prune(surfels, adam, gradient, rig, extent, Density(**settings), np.random.default_rng(0))


def test_opaque_surfels_with_small_gradients_do_not_change(rig):
    surfels, adam = scene(rig)
    before = to_arrays(surfels)
    after = to_arrays(run(surfels, adam, np.full(len(surfels), 1e-9), rig))
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)


def test_a_small_surfel_is_cloned_with_its_binding_and_a_fresh_optimiser_state(rig):
    surfels, adam = scene(rig)
    gradient = np.zeros(len(surfels))
    gradient[5] = 1.0
    after = run(surfels, adam, gradient, rig, extent=10.0)  # 0.4 k << 0.01 extents
    assert len(after) == len(surfels) + 1
    twins = np.flatnonzero(after.binding == 5)
    assert len(twins) == 2
    for name, value in after.attributes():
        np.testing.assert_array_equal(value[twins[0]].detach(), getattr(surfels, name)[5].detach())
        np.testing.assert_array_equal(value[twins[1]].detach(), getattr(surfels, name)[5].detach())
        moments = adam.first[name][twins].reshape(2, -1)
        assert (moments[0] == 6).all()
        assert (moments[1] == 0).all()


def test_a_large_surfel_is_split_around_its_place_in_local_units(rig):
    surfels, _ = scene(rig)
    gradient = np.zeros(len(surfels))
    gradient[7] = 1.0
    offsets = []
    for seed in range(200):
        children = densify_and_prune(
            surfels, Adam(surfels), gradient, rig, 1e-3, Density(), np.random.default_rng(seed)
        )  # the extent is tiny, so every surfel is large
        of_face = np.flatnonzero(children.binding == 7)
        assert len(of_face) == 2
        assert len(children) == len(surfels) + 1
        np.testing.assert_allclose(children.log_scale[of_face].detach(), np.log(0.4 / 1.6), rtol=1e-5)
        offsets.append((children.position[of_face] - surfels.position[7]).detach().numpy())
    offsets = np.concatenate(offsets)
    # Children are scattered as the surfel itself is: 0.4 triangle units in its plane, nothing across.
    assert offsets[:, :2].std(axis=0) == pytest.approx([0.4, 0.4], rel=0.1)
    assert np.abs(offsets[:, 2]).max() < 1e-6


def test_transparent_surfels_are_pruned_unless_they_are_the_last_of_their_face(rig):
    surfels, _ = scene(rig)
    arrays = to_arrays(surfels)
    arrays = {name: np.concatenate([value, value[:10]]) for name, value in arrays.items()}  # faces 0..9 have two
    arrays["opacity"] = arrays["opacity"].copy()
    arrays["opacity"][len(surfels) :] = -9  # the second of each
    arrays["opacity"][20] = -9  # the only one
    arrays["opacity"][[3, len(surfels) + 3]] = -9, -8  # both
    doubled = from_arrays(**arrays)
    after = run(doubled, Adam(doubled), np.zeros(len(doubled)), rig)
    np.testing.assert_array_equal(after.binding, np.arange(len(rig.faces)))
    assert after.opacity[3].item() == -8  # the more opaque of the two
    assert after.opacity[20].item() == -9


def test_one_per_face_holds_for_any_prune_set():
    rng = np.random.default_rng(4)
    for _ in range(20):
        binding, opacity = rng.integers(0, 12, 60), rng.normal(size=60)
        pruned = rng.random(60) < 0.9
        keep = keep_one_per_face(binding, pruned, opacity)
        assert set(binding[keep]) == set(binding)
        assert keep[~pruned].all()
        saved = np.flatnonzero(keep & pruned)
        assert len(set(binding[saved])) == len(saved)
        assert not set(binding[saved]) & set(binding[~pruned])


def test_the_budget_goes_to_the_largest_gradients(rig):
    surfels, adam = scene(rig)
    gradient = 1.0 + np.arange(len(surfels))
    after = run(surfels, adam, gradient, rig, max_surfels=len(surfels) + 3)
    assert len(after) == len(surfels) + 3
    counts = np.bincount(after.binding)
    np.testing.assert_array_equal(np.flatnonzero(counts == 2), len(surfels) - 3 + np.arange(3))


def test_at_the_budget_the_least_important_surfels_are_replaced(rig):
    surfels, _ = scene(rig)
    n = len(surfels)
    doubled = from_arrays(**{name: np.concatenate([value, value]) for name, value in to_arrays(surfels).items()})
    gradient, importance = np.zeros(2 * n), 1 + np.random.default_rng(3).random(2 * n)
    gradient[[2 * 3, 2 * 8]] = 1.0  # surfels are sorted by face
    importance[[2 * 3, 2 * 5, 2 * 7 + 1]] = 0, 0.1, 0.2  # the first does not count: it is cloned
    after = densify_and_prune(
        doubled, Adam(doubled), gradient, rig, 1.0, Density(max_surfels=2 * n), np.random.default_rng(0),
        lambda: importance,
    )  # fmt: skip
    expected = np.full(n, 2)
    expected[[3, 8]], expected[[5, 7]] = 3, 1
    np.testing.assert_array_equal(np.bincount(after.binding), expected)


def test_an_unimportant_surfel_is_kept_if_it_is_the_last_of_its_face(rig):
    surfels, adam = scene(rig)
    gradient = np.zeros(len(surfels))
    gradient[3] = 1.0
    after = densify_and_prune(
        surfels, adam, gradient, rig, 1.0, Density(max_surfels=len(surfels)), np.random.default_rng(0),
        lambda: np.zeros(len(surfels)),
    )  # fmt: skip
    np.testing.assert_array_equal(after.binding, np.arange(len(surfels)))


def test_importance_is_not_computed_if_the_budget_suffices(rig):
    def importance():
        raise AssertionError("called")

    surfels, adam = scene(rig)
    gradient = np.ones(len(surfels))
    densify_and_prune(surfels, adam, gradient, rig, 1.0, Density(), np.random.default_rng(0), importance)


def test_surfels_stay_sorted_by_face_and_moments_follow_them(rig):
    surfels, adam = scene(rig)
    gradient = 4e-4 * np.random.default_rng(2).random(len(surfels))  # about half are above the threshold
    after = run(surfels, adam, gradient, rig, extent=2.0)
    assert len(after) > len(surfels)
    assert (np.diff(after.binding) >= 0).all()
    tag = adam.first["opacity"]
    old = tag > 0
    np.testing.assert_array_equal(after.binding[old], (tag[old] - 1).astype(int))
    for name, value in after.attributes():
        assert adam.first[name].shape == tuple(value.shape) == adam.second[name].shape
        assert value.is_leaf and value.requires_grad


def test_gradients_are_averaged_over_the_views_that_saw_the_surfel():
    camera = Camera(np.eye(4), 100.0, 100.0, 20.0, 10.0, 40, 20)
    statistics = GradientStatistics(3)
    seen = torch.tensor([True, True, False])
    statistics.add(SimpleNamespace(visible=seen, gradient=torch.tensor([[3.0, 8.0], [1, 0], [9, 9]])), camera)
    seen = torch.tensor([True, False, False])
    statistics.add(SimpleNamespace(visible=seen, gradient=torch.tensor([[0.0, 1.0], [9, 9], [9, 9]])), camera)
    # In NDC a pixel's gradient grows by half the image: 20 and 10 pixels.
    np.testing.assert_allclose(statistics.mean(), [(100 + 10) / 2, 20, 0])


def test_opacities_are_capped(rig):
    surfels, adam = scene(rig)
    surfels.opacity.data[3] = -7
    reset_opacity(surfels, adam)
    opacity = torch.sigmoid(surfels.opacity.detach())
    assert opacity[3] == torch.sigmoid(torch.tensor(-7.0))
    np.testing.assert_allclose(np.delete(opacity.numpy(), 3), 0.01, rtol=1e-5)
    assert not adam.first["opacity"].any()


def test_extent_grows_with_the_scene():
    cameras = {}
    for i, x in enumerate((-2.0, 0.0, 2.0)):
        pose = np.eye(4)
        pose[0, 3] = -x
        cameras[i] = Camera(pose, 1.0, 1.0, 0.0, 0.0, 1, 1)
    assert scene_extent(cameras) == pytest.approx(2.2)
