"""The calls into gsplat, on the CPU against its own PyTorch reference: conventions, shapes, gradients, cap, culling."""

from functools import partial

import gsplat_on_cpu
import numpy as np
import pytest
import torch
from stress.surfel_reference import render
from surfel_clouds import CAMERA, FRONTAL, ODD, cloud, degenerate_cloud, layers, relative, tensors, upstream

from carigs.splat.rasterizer.cuda import rasterize_gsplat
from carigs.splat.rasterizer.rasterize import OUTPUTS, WorldSurfels, rasterize

pytest.importorskip("gsplat", reason="gsplat is not installed: pip install --no-deps gsplat==1.5.3")
CAP = gsplat_on_cpu.CAP
COMPARED = tuple(name for name in OUTPUTS if name != "distortion")


@pytest.fixture
def gsplat_render():
    with gsplat_on_cpu.functions() as functions:
        yield partial(rasterize_gsplat, functions, outputs=COMPARED, device=torch.device("cpu"))


@pytest.mark.parametrize("background", [0.0, 0.7])
@pytest.mark.parametrize(
    ("arrays", "camera"),
    [
        (cloud(150, 0), CAMERA),
        (cloud(200, 1, size=0.02), ODD),
        (cloud(100, 2, size=0.3, opacity=(0.5, 1.0)), CAMERA),
        (degenerate_cloud(), FRONTAL),
        (layers(40, 6), FRONTAL),
    ],
    ids=["cloud", "small", "opaque", "degenerate", "layers"],
)
def test_agrees_with_the_dense_reference(gsplat_render, arrays, camera, background):
    single, double = tensors(arrays, grad=True), tensors(arrays, torch.float64, grad=True)
    rendered = gsplat_render(WorldSurfels(*single), camera, background=background)
    expected = render(double, camera, alpha_cap=CAP)
    expected["colour"] = expected["colour"] + background * (1 - expected["alpha"])[..., None]
    clear = expected.pop("margin") > 1e-3
    assert clear.float().mean() > 0.9
    for name in COMPARED:
        torch.testing.assert_close(getattr(rendered, name)[clear].double(), expected[name][clear], rtol=0, atol=1e-4)
    upstream(rendered, clear, 5).backward()
    upstream({name: expected[name] if name in COMPARED else None for name in OUTPUTS}, clear, 5).backward()
    errors = [relative(a.grad, b.grad) for a, b in zip(single, double, strict=True)]
    assert max(errors) < 1e-4, errors


def test_agrees_with_the_cpu_backend_in_what_density_control_needs(gsplat_render):
    """Visibility, and the gradient with respect to the projected centres."""
    arrays, screens = cloud(150, 3, opacity=(0.02, 0.9)), []
    for draw in (gsplat_render, partial(rasterize, outputs=COMPARED, alpha_cap=CAP)):
        rendered = draw(WorldSurfels(*tensors(arrays, grad=True)), ODD, background=0.3)
        upstream(rendered, torch.ones(45, 71), 4).backward()
        screens.append(rendered.screen)
    assert (screens[0].visible | ~screens[1].visible).all()  # boxes of gsplat are squares of whole pixels
    assert relative(screens[0].gradient, screens[1].gradient.double()) < 1e-4


def disc(scale, opacity, pixel=(20, 14)):
    """A round white disc two metres in front of FRONTAL, around a pixel's centre."""
    x, y = (pixel[0] + 0.5 - FRONTAL.cx) / 40, (FRONTAL.cy - pixel[1] - 0.5) / 40
    return [[[x, y, 0.0]], [[scale, 0, 0]], [[0, scale, 0]], [opacity], [[1.0, 1.0, 1.0]]]


def test_pixel_centres_cap_background_and_the_sign_of_normals(gsplat_render):
    """Closed forms at the pixel in the middle of a disc, and at its neighbours."""
    sigma = 3 / 40  # three pixels
    for opacity, expected in ((0.6, 0.6), (1.0, CAP)):
        image = gsplat_render(WorldSurfels(*tensors(disc(sigma, opacity))), FRONTAL, background=0.25)
        assert image.alpha[14, 20].item() == pytest.approx(expected, abs=1e-5)
        assert image.alpha[14, 22].item() == pytest.approx(min(opacity * np.exp(-2 / 9), CAP), abs=1e-5)
        torch.testing.assert_close(image.alpha[14, 17:20], image.alpha[14, 21:24].flip(0), atol=1e-5, rtol=0)
        assert image.colour[14, 20, 0].item() == pytest.approx(expected + 0.25 * (1 - expected), abs=1e-5)
        assert image.depth[14, 20].item() == pytest.approx(2 * expected, abs=1e-5)
        torch.testing.assert_close(image.normal[14, 20], torch.tensor([0.0, 0.0, -expected]), atol=1e-5, rtol=0)
        assert image.colour[0, 0, 0] == 0.25


def test_discs_smaller_than_a_pixel_are_not_widened(gsplat_render):
    """gsplat's low-pass filter would draw 0.8 exp(-1) beside them."""
    alpha = gsplat_render(WorldSurfels(*tensors(disc(1e-5, 0.8))), FRONTAL, background=0.0).alpha
    assert alpha[14, 20].item() == pytest.approx(0.8, abs=1e-4)
    assert alpha.count_nonzero() == 1


def test_broken_surfels_are_not_drawn_and_get_zero_gradients(gsplat_render):
    arrays = [np.array(a, np.float32) for a in cloud(40, 9)]
    alone = gsplat_render(WorldSurfels(*tensors(arrays)), CAMERA, background=0.0)
    bad = [np.concatenate([a, a[:4]]) for a in arrays]
    for field, (row, value) in zip(bad, ((40, np.nan), (41, np.inf), (42, 0), (43, np.nan), (43, np.nan)), strict=True):
        field[row] = value
    leaves = tensors(bad, grad=True)
    rendered = gsplat_render(WorldSurfels(*leaves), CAMERA, background=0.0)
    for name in COMPARED:
        assert torch.equal(getattr(rendered, name), getattr(alone, name))
    upstream(rendered, torch.ones(48, 64), 2).backward()
    assert all((leaf.grad[40:] == 0).all() and leaf.grad.isfinite().all() for leaf in leaves)
    assert not rendered.screen.visible[40:].any()


def test_an_empty_view_shows_the_background(gsplat_render):
    surfels = tensors(cloud(20, 1), grad=True)
    away = WorldSurfels(surfels[0] + 50, *surfels[1:])
    rendered = gsplat_render(away, CAMERA, background=0.3)
    assert (rendered.colour == 0.3).all() and not rendered.screen.visible.any()
