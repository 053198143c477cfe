"""The photometric loss against a direct form in float64 PyTorch."""

import numba
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.splat.training.device.photometric_loss import photometric_loss as device_loss
from carigs.splat.training.photometric_loss import photometric_loss


def plain_ssim(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """SSIM map of (h, w, 3) images by a dense 11 x 11 convolution."""
    offsets = torch.arange(-5, 6, dtype=torch.float64)
    taps = torch.exp(-(offsets**2) / 4.5)
    window = torch.outer(taps, taps) / taps.sum() ** 2
    planes = [t.permute(2, 0, 1)[:, None] for t in (x, y)]

    def blur(p):
        return torch.nn.functional.conv2d(p, window[None, None], padding=5)

    (m, n), (xx, yy) = map(blur, planes), (blur(p * p) for p in planes)
    xy = blur(planes[0] * planes[1])
    c1, c2 = 0.01**2, 0.03**2
    top = (2 * m * n + c1) * (2 * (xy - m * n) + c2)
    return (top / ((m**2 + n**2 + c1) * (xx - m**2 + yy - n**2 + c2)))[:, 0].permute(1, 2, 0)


def plain(image, target, weight, valid=None):
    if valid is not None:
        target = torch.where(valid[..., None], target, image.detach())
    ssim = plain_ssim(image, target)
    return (1 - weight) * (image - target).abs().mean() + weight * (1 - ssim.mean())


def pair(seed: int, height: int, width: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    x = torch.rand(height, width, 3, generator=generator)
    return x, (0.6 * x + 0.4 * torch.rand(height, width, 3, generator=generator))


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 70), st.integers(1, 45), st.sampled_from([0.0, 0.2, 1.0]))
def test_value_and_gradient_agree_with_float64(seed, height, width, weight):
    x, y = pair(seed, height, width)
    single, double = x.clone().requires_grad_(), x.double().requires_grad_()
    fused, expected = photometric_loss(single, y, weight), plain(double, y.double(), weight)
    assert fused.item() == pytest.approx(expected.item(), abs=2e-6)
    fused.backward()
    expected.backward()
    error = (single.grad.double() - double.grad).norm() / double.grad.norm()
    assert error < 2e-5


def test_masked_pixels_get_no_gradient_and_the_others_that_of_a_pasted_target():
    x, y = pair(3, 50, 40)
    valid = torch.rand(50, 40, generator=torch.Generator().manual_seed(4)) > 0.4
    single, double = x.clone().requires_grad_(), x.double().requires_grad_()
    fused, expected = photometric_loss(single, y, 0.2, valid), plain(double, y.double(), 0.2, valid)
    assert fused.item() == pytest.approx(expected.item(), abs=1e-6)
    fused.backward()
    expected.backward()
    assert (single.grad[~valid] == 0).all()
    torch.testing.assert_close(single.grad[valid].double(), double.grad[valid], rtol=1e-3, atol=1e-8)


def test_equal_images_have_no_loss():
    x, _ = pair(5, 33, 20)
    assert photometric_loss(x, x).item() == pytest.approx(0, abs=1e-6)


def test_upstream_scales_the_gradient():
    x, y = pair(6, 20, 20)
    one, three = x.clone().requires_grad_(), x.clone().requires_grad_()
    photometric_loss(one, y).backward()
    (3 * photometric_loss(three, y)).backward()
    torch.testing.assert_close(three.grad, 3 * one.grad)


@pytest.mark.parametrize("loss", [photometric_loss, device_loss])
def test_emphasis_multiplies_the_gradient_of_each_pixel_and_not_the_value(loss):
    x, y = pair(8, 40, 30)
    generator = torch.Generator().manual_seed(9)
    valid, emphasis = torch.rand(40, 30, generator=generator) > 0.3, 1 + 3 * torch.rand(40, 30, generator=generator)
    plain, emphasised = x.clone().requires_grad_(), x.clone().requires_grad_()
    values = [loss(plain, y, 0.2, valid), loss(emphasised, y, 0.2, valid, emphasis)]
    for value in values:
        value.backward()
    assert values[1].item() == pytest.approx(values[0].item(), abs=1e-6)
    torch.testing.assert_close(emphasised.grad, plain.grad * emphasis[..., None], rtol=1e-3, atol=1e-8)


def test_same_bytes_at_any_number_of_threads():
    x, y = pair(7, 100, 64)
    results, before = [], numba.get_num_threads()
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            image = x.clone().requires_grad_()
            loss = photometric_loss(image, y)
            loss.backward()
            results.append((loss.item(), image.grad.numpy().tobytes()))
    finally:
        numba.set_num_threads(before)
    assert results[0] == results[1]
