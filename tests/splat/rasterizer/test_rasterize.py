"""The surfel rasterizer against the dense float64 reference, closed forms and invariances."""

from copy import copy
from dataclasses import replace
from functools import cache

import numba
import numpy as np
import pytest
import torch
from stress.surfel_reference import render
from surfel_clouds import CAMERA, FRONTAL, ODD, cloud, degenerate_cloud, layers, relative, tensors, upstream

from carigs.errors import CarigsError, SettingsError
from carigs.splat.rasterizer import torch_compositing, torch_projection
from carigs.splat.rasterizer.rasterize import OUTPUTS, WorldSurfels, rasterize

SCENES = {
    "cloud": (cloud(200, 0), CAMERA, OUTPUTS, 0.99),
    "small": (cloud(300, 1, size=0.02), ODD, OUTPUTS, 0.99),
    "opaque": (cloud(150, 2, size=0.3, opacity=(0.5, 1.0)), CAMERA, OUTPUTS, 0.999),
    "colour": (cloud(200, 3), ODD, ("colour", "alpha"), 0.99),
    "colour alone": (cloud(200, 4), ODD, ("colour",), 0.99),
    "degenerate": (degenerate_cloud(), FRONTAL, OUTPUTS, 0.99),
    "layers": (layers(70, 6), FRONTAL, OUTPUTS, 0.99),
}
"""Arrays of surfels, camera, outputs and cap on alpha."""


@cache
def reference(scene, background):
    """Images of the dense reference, the pixels that are compared, and gradients."""
    arrays, camera, outputs, cap = SCENES[scene]
    double = tensors(arrays, torch.float64, grad=True)
    images = render(double, camera, alpha_cap=cap)
    images["colour"] = images["colour"] + background * (1 - images["alpha"])[..., None]
    # Within 1e-4 of a threshold, float32 may fall on the other side.
    clear = images.pop("margin") > 1e-4
    upstream({name: images[name] if name in outputs else None for name in OUTPUTS}, clear, 5).backward()
    return {name: image.detach() for name, image in images.items()}, clear, [t.grad for t in double]


@pytest.mark.parametrize(("backend", "background"), [("cpu", 0.0), ("cpu", 0.7), ("torch", 0.7)])
@pytest.mark.parametrize("scene", SCENES)
def test_agrees_with_the_dense_reference(scene, backend, background):
    arrays, camera, outputs, cap = SCENES[scene]
    single = tensors(arrays, grad=True)
    rendered = rasterize(
        WorldSurfels(*single), camera, backend=backend, outputs=outputs, background=background, alpha_cap=cap
    )
    expected, clear, gradients = reference(scene, background)
    assert clear.float().mean() > 0.95
    for name in outputs:
        torch.testing.assert_close(getattr(rendered, name)[clear].double(), expected[name][clear], rtol=0, atol=1e-5)
    upstream(rendered, clear, 5).backward()
    errors = [relative(t.grad, gradient) for t, gradient in zip(single, gradients, strict=True)]
    assert max(errors) < 1e-4, errors


@pytest.mark.parametrize("other", ["scalar", "torch"])
def test_backends_agree(other):
    """In every branch."""
    for arrays, camera in ((degenerate_cloud(), FRONTAL), (layers(70, 7), FRONTAL), (cloud(300, 17, size=0.03), ODD)):
        leaves = [tensors(arrays, grad=True) for _ in range(2)]
        images = [
            rasterize(WorldSurfels(*t), camera, backend=b, background=0.4)
            for t, b in zip(leaves, ("cpu", other), strict=True)
        ]
        # Where rounding at a threshold changes the set of contributing surfels, alpha jumps by 1/255.
        same = (images[0].alpha - images[1].alpha).abs() < 1e-5
        assert same.float().mean() > 0.99
        for name in OUTPUTS:
            first, second = (getattr(image, name)[same] for image in images)
            torch.testing.assert_close(first, second, rtol=0, atol=1e-5)
        for image in images:
            upstream(image, same, 8).backward()
        assert torch.equal(images[0].screen.visible, images[1].screen.visible)
        gradients = [[*(t.grad for t in t5), i.screen.gradient] for t5, i in zip(leaves, images, strict=True)]
        assert max(relative(a, b.double()) for a, b in zip(*gradients, strict=True)) < 1e-4


def test_the_torch_backend_computes_the_same_in_small_groups(monkeypatch):
    """With one pixel of a tile at a time, where a list is long."""
    results = []
    for elements in (torch_compositing.MAX_ELEMENTS, 100):
        monkeypatch.setattr(torch_compositing, "MAX_ELEMENTS", elements)
        leaves = tensors(cloud(120, 5), grad=True)
        image = rasterize(WorldSurfels(*leaves), FRONTAL, backend="torch")
        upstream(image, torch.ones(40, 48), 3).backward()
        results.append(([getattr(image, name).detach() for name in OUTPUTS], [t.grad for t in leaves]))
    for found, expected in zip(results[1][0], results[0][0], strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-6)
    assert max(relative(a, b.double()) for a, b in zip(results[1][1], results[0][1], strict=True)) < 1e-5


def test_the_torch_backend_without_float64(monkeypatch):
    """As on Apple's GPUs: pixel positions have the spacing of float32."""
    monkeypatch.setattr(torch_projection, "wide", lambda device: torch.float32)
    single, double = tensors(cloud(200, 0), grad=True), tensors(cloud(200, 0), torch.float64, grad=True)
    found, expected = rasterize(WorldSurfels(*single), CAMERA, backend="torch"), render(double, CAMERA)
    clear = expected.pop("margin") > 1e-3
    for name in OUTPUTS:
        torch.testing.assert_close(getattr(found, name)[clear].double(), expected[name][clear], rtol=0, atol=1e-4)
    upstream(found, clear, 5).backward()
    upstream(expected, clear, 5).backward()
    assert max(relative(a.grad, b.grad) for a, b in zip(single, double, strict=True)) < 1e-3


def test_surfels_behind_opaque_layers_get_no_gradient():
    arrays = layers(70, 8)
    surfels = tensors(arrays, grad=True)
    image = rasterize(WorldSurfels(*surfels), FRONTAL)
    upstream(image, torch.ones(40, 48), 9).backward()
    behind = np.argsort(-arrays[0][:, 2])[40:]
    assert all((t.grad[behind] == 0).all() for t in surfels)
    assert all((t.grad[np.argsort(-arrays[0][:, 2])[:3]] != 0).any() for t in surfels)


@pytest.mark.parametrize("backend", ["cpu", "torch"])
def test_invalid_surfels_are_culled(backend):
    good = cloud(30, 4)
    bad = cloud(30, 5)
    for k, (array, value) in enumerate(((0, np.nan), (0, np.inf), (1, np.nan), (2, -np.inf), (3, np.nan), (4, np.nan))):
        np.atleast_2d(bad[array].T)[0, k] = value
    bad[0][6:12] = [0.6, 0.8, 4.0]  # behind the camera
    bad[0][12:18] = CAMERA.centre  # at it
    bad[1][18:24] = 0
    bad[3][24:27] = 0
    bad[3][27:] = -1
    both = tensors([np.concatenate(pair) for pair in zip(good, bad, strict=True)], grad=True)
    alone = rasterize(WorldSurfels(*tensors(good)), CAMERA, backend=backend)
    together = rasterize(WorldSurfels(*both), CAMERA, backend=backend)
    for name in OUTPUTS:
        assert torch.equal(getattr(alone, name), getattr(together, name))
    assert not together.screen.visible[30:].any()
    upstream(together, torch.ones(48, 64), 6).backward()
    for tensor in both:
        assert (tensor.grad[30:] == 0).all()
        assert tensor.grad.isfinite().all()


@pytest.mark.parametrize("backend", ["cpu", "torch"])
def test_no_surfels_give_an_empty_image(backend):
    empty = WorldSurfels(*(t[:0] for t in tensors(cloud(1, 0))))
    rendered = rasterize(empty, ODD, backend=backend)
    assert all(not getattr(rendered, name).any() for name in OUTPUTS)
    assert rendered.colour.shape == (45, 71, 3)


def test_a_frontal_surfel_is_a_gaussian():
    sigma, z, opacity = 0.15, -0.5, 0.8
    arrays = [[[0.1, 0.05, z]], [[sigma, 0, 0]], [[0, 2 * sigma, 0]], [opacity], [[0.2, 0.5, 0.9]]]
    image = rasterize(WorldSurfels(*tensors(arrays)), FRONTAL)
    depth = 2 - z
    x, y = np.meshgrid(np.arange(48) + 0.5, np.arange(40) + 0.5)
    dx, dy = x - (24 + 80 * 0.1 / depth), y - (20 - 80 * 0.05 / depth)
    one = 80 * sigma / depth
    expected = opacity * np.exp(-(dx**2 + dy**2 / 4) / (2 * one**2))
    expected[expected < 1 / 255] = 0
    np.testing.assert_allclose(image.alpha, expected, atol=1e-6)
    np.testing.assert_allclose(image.colour, expected[..., None] * [0.2, 0.5, 0.9], atol=1e-6)
    np.testing.assert_allclose(image.depth, expected * depth, atol=1e-5)
    np.testing.assert_allclose(image.normal, expected[..., None] * [0, 0, -1], atol=1e-6)
    assert not image.distortion.any()


def test_a_surfel_smaller_than_a_pixel_shows_where_it_covers_the_centre():
    """It lies on a corner of four pixels, or on the centre of one; nothing widens it."""
    arrays = [[[0.0, 0.0, 0.0]], [[1e-4, 0, 0]], [[0, 1e-4, 0]], [0.9], [[1.0, 1.0, 1.0]]]
    assert not rasterize(WorldSurfels(*tensors(arrays)), FRONTAL).alpha.any()
    image = rasterize(WorldSurfels(*tensors(arrays)), replace(FRONTAL, cx=24.5, cy=20.5))
    assert image.alpha[20, 24] == pytest.approx(0.9) and np.count_nonzero(image.alpha) == 1


def test_an_image_of_a_third_of_the_size_is_every_third_pixel():
    """Images are samples at the pixels' centres, whatever their size."""
    surfels = WorldSurfels(*tensors(cloud(200, 5)))
    image, small = (
        rasterize(surfels, replace(CAMERA, fx=k * CAMERA.fx, fy=k * CAMERA.fy, cx=k * CAMERA.cx, cy=k * CAMERA.cy,
                                   width=k * CAMERA.width, height=k * CAMERA.height))
        for k in (3, 1)
    )  # fmt: skip
    for name in ("colour", "alpha", "depth"):
        difference = (getattr(image, name)[1::3, 1::3] - getattr(small, name)).abs()
        assert difference.max() < 0.01 and difference.mean() < 1e-5  # alphas next to the threshold may differ


def test_alpha_and_distortion_of_two_layers():
    """alpha = a + (1 - a) b and distortion = 2 w_1 w_2 |Z_1 - Z_2|; the order in memory does not matter."""
    centre, wide = [[0, 0, -0.4], [0, 0, 0.3]], 50.0
    arrays = [centre, [[wide, 0, 0]] * 2, [[0, wide, 0]] * 2, [0.6, 0.7], [[1, 0, 0], [0, 1, 0]]]
    image = rasterize(WorldSurfels(*tensors(arrays)), FRONTAL)
    near, far = 0.7, 0.3 * 0.6
    for plane, expected in (
        (image.alpha, near + far),
        (image.colour[..., 0], far),
        (image.colour[..., 1], near),
        (image.depth, near * 1.7 + far * 2.4),
        (image.distortion, 2 * near * far * 0.7),
    ):
        np.testing.assert_allclose(plane, expected, atol=1e-4)


def test_weights_sum_to_alpha():
    arrays = cloud(200, 8, size=0.15)
    arrays[4] = np.ones_like(arrays[4])
    image = rasterize(WorldSurfels(*tensors(arrays)), CAMERA)
    torch.testing.assert_close(image.colour, image.alpha[..., None].expand(-1, -1, 3), rtol=0, atol=2e-6)
    assert image.alpha.max() <= 1
    mean = (image.depth / image.alpha)[image.alpha > 0.1]
    z = CAMERA.to_camera(arrays[0])[:, 2]
    assert z.min() <= mean.min() and mean.max() <= z.max()


def test_order_in_memory_does_not_matter():
    arrays = cloud(150, 9)
    order = np.random.default_rng(0).permutation(150)
    first, second = tensors(arrays, grad=True), tensors([a[order] for a in arrays], grad=True)
    images = [rasterize(WorldSurfels(*t), CAMERA) for t in (first, second)]
    assert all(torch.equal(getattr(images[0], name), getattr(images[1], name)) for name in OUTPUTS)
    for image in images:
        upstream(image, torch.ones(48, 64), 2).backward()
    assert all(torch.equal(a.grad[order], b.grad) for a, b in zip(first, second, strict=True))


def test_equal_depths_are_composited_in_the_order_of_memory():
    arrays = [[[0, 0, 0]] * 2, [[9, 0, 0]] * 2, [[0, 9, 0]] * 2, [0.9, 0.9], [[1, 0, 0], [0, 1, 0]]]
    colour = rasterize(WorldSurfels(*tensors(arrays)), FRONTAL).colour[20, 24]
    np.testing.assert_allclose(colour, [0.9, 0.09, 0], atol=1e-4)


def test_rotating_the_tangents_in_their_plane_changes_nothing():
    """A Gaussian is isotropic in its disc coordinates: (u, v) R is the same disc for any rotation R."""
    centre, u, v, opacity, colour = cloud(100, 10)
    angle = np.random.default_rng(1).uniform(0, 2 * np.pi, (100, 1))
    turned = [centre, np.cos(angle) * u - np.sin(angle) * v, np.sin(angle) * u + np.cos(angle) * v, opacity, colour]
    first, second = (rasterize(WorldSurfels(*tensors(a)), ODD) for a in (cloud(100, 10), turned))
    for name in OUTPUTS:
        torch.testing.assert_close(getattr(first, name), getattr(second, name), rtol=0, atol=3e-4)


def test_fewer_outputs_are_the_same_bytes():
    surfels = WorldSurfels(*tensors(cloud(150, 11)))
    whole, part = rasterize(surfels, CAMERA), rasterize(surfels, CAMERA, outputs=("alpha", "colour"))
    assert torch.equal(whole.colour, part.colour) and torch.equal(whole.alpha, part.alpha)
    assert part.depth is part.normal is part.distortion is None


def test_screen_gradients_sum_to_that_of_the_principal_point():
    """A shift of the principal point shifts every projected centre equally."""
    arrays, clear = cloud(40, 12), None
    images = []
    for shift in (-1e-5, 1e-5):
        images.append(render(tensors(arrays, torch.float64), replace(CAMERA, cx=CAMERA.cx + shift)))
        margin = images[-1].pop("margin") > 1e-3
        clear = margin if clear is None else clear & margin
    slope = (upstream(images[1], clear, 3) - upstream(images[0], clear, 3)) / 2e-5
    rendered = rasterize(WorldSurfels(*tensors(arrays, grad=True)), CAMERA)
    upstream(rendered, clear, 3).backward()
    assert rendered.screen.gradient[:, 0].double().sum().item() == pytest.approx(slope.item(), rel=1e-4)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one thread")
def test_same_bytes_at_any_number_of_threads():
    results, before = [], numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            surfels = tensors(cloud(300, 13), grad=True)
            image = rasterize(WorldSurfels(*surfels), ODD)
            upstream(image, torch.ones(45, 71), 4).backward()
            parts = [getattr(image, name).detach() for name in OUTPUTS] + [t.grad for t in surfels]
            results.append([part.contiguous().numpy().tobytes() for part in parts])
    finally:
        numba.set_num_threads(before)
    assert results[0] == results[1]


def with_field(surfels, name, value):
    """A copy with another tensor; set after construction, where the tests check shapes already."""
    changed = copy(surfels)
    setattr(changed, name, value)
    return changed


def test_invalid_arguments_raise():
    surfels = WorldSurfels(*tensors(cloud(5, 14)))
    with pytest.raises(SettingsError, match="vulkan"):
        rasterize(surfels, CAMERA, backend="vulkan")
    with pytest.raises(SettingsError, match="albedo"):
        rasterize(surfels, CAMERA, outputs=("colour", "albedo"))
    with pytest.raises(SettingsError, match="alpha_cap"):
        rasterize(surfels, CAMERA, alpha_cap=1.0)
    with pytest.raises(ValueError, match=r"surfels\.opacity"):
        rasterize(with_field(surfels, "opacity", surfels.opacity[:, None]), CAMERA)
    with pytest.raises(ValueError, match=r"surfels\.centre"):
        rasterize(with_field(surfels, "centre", surfels.centre.double()), CAMERA)


@pytest.mark.skipif(torch.cuda.is_available(), reason="CUDA device available")
def test_cuda_without_a_device_is_a_readable_error():
    with pytest.raises(CarigsError, match="cuda"):
        rasterize(WorldSurfels(*tensors(cloud(5, 15))), CAMERA, backend="cuda")


def test_disc_homographies_map_points_of_the_disc():
    """The homography maps disc points to pixels; boxes contain the visible part; their centre is that at one sigma."""
    from carigs.splat.rasterizer.cuda import disc_homographies

    surfels = WorldSurfels(*tensors(cloud(40, 16)))
    projected = disc_homographies(surfels, CAMERA)
    assert projected.kept.all()
    angle = torch.linspace(0, 2 * np.pi, 2001)
    circle = torch.stack([angle.cos(), angle.sin(), torch.ones_like(angle)])
    for i in range(40):
        points = surfels.centre[i] + circle[:2].T @ torch.stack([surfels.tangent_u[i], surfels.tangent_v[i]])
        pixels, depth = CAMERA.project(points.double().numpy())
        homogeneous = (projected.homography[i] @ circle).T
        np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], pixels, atol=1e-3)
        np.testing.assert_allclose(homogeneous[:, 2], depth, rtol=1e-5)
        rho = np.sqrt(2 * np.log(255 * surfels.opacity[i].item()))
        points = surfels.centre[i] + rho * (points - surfels.centre[i])
        reach = np.abs(CAMERA.project(points.double().numpy())[0] - projected.box_centre[i].numpy()).max(0)
        assert (reach <= projected.radius[i].numpy() + 1e-2).all() or (projected.radius[i] == 0).all()


@pytest.mark.parametrize("angle", np.linspace(0, np.pi, 13))
def test_thin_surfels_across_tiles_are_drawn_as_by_plain_loops(angle):
    """To the last pixel: wherever alpha is 1/255 or more."""
    camera = replace(FRONTAL, fx=300, fy=300, cx=63.3, cy=58.7, width=127, height=120)
    along = np.array([np.cos(angle), np.sin(angle), 0.3])
    across = np.cross(along, [0.2, -0.4, 1.0])
    for thickness in (1e-3, 6e-3, 0.03):
        arrays = [[[0.01, -0.02, 0.1]], [0.12 * along], [thickness * across], [0.97], [[0.2, 0.5, 0.9]]]
        arrays = [np.repeat(a, 16, 0) for a in arrays]
        arrays[3][1:] = 0  # the vector kernels take sixteen
        images = [rasterize(WorldSurfels(*tensors(arrays)), camera, backend=b).alpha for b in ("cpu", "scalar")]
        differs = (images[0] - images[1]).abs() > 1e-5
        # A pixel exactly at the threshold may fall on either side.
        assert differs.sum() <= 1 and (images[1][differs] < 1.01 / 255).all()
        assert (images[1] > 0).sum() > 50


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize(
    "arrays", [cloud(200, 0, opacity=(0.02, 0.9)), degenerate_cloud()], ids=["cloud", "degenerate"]
)
def test_cuda_agrees_with_cpu(arrays):
    pytest.importorskip("gsplat")
    # gsplat has its own cap on alpha: stay below both.
    arrays[3] = np.minimum(arrays[3], 0.98)
    leaves = [tensors(arrays, grad=True) for _ in range(2)]
    clear = render(tensors(arrays, torch.float64), CAMERA).pop("margin") > 1e-4
    images = []
    for tensor, backend in zip(leaves, ("cpu", "cuda"), strict=True):
        images.append(rasterize(WorldSurfels(*tensor), CAMERA, backend=backend, background=0.4))
        upstream(images[-1], clear, 5).backward()
    for name in OUTPUTS:
        torch.testing.assert_close(getattr(images[0], name)[clear], getattr(images[1], name)[clear], rtol=0, atol=1e-3)
    errors = [relative(b.grad, a.grad.double()) for a, b in zip(*leaves, strict=True)]
    errors.append(relative(images[1].screen.gradient, images[0].screen.gradient.double()))
    assert max(errors) < 1e-2, errors
