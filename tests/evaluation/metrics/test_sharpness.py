"""Sharpness: gradients that are known, and the effect of a Gaussian blur on white noise and on waves."""

import cv2
import numpy as np
import pytest

from evaluation.metrics.sharpness import gradient_energy, sharpness

EVERYWHERE = np.ones((256, 256), bool)
INNER = np.zeros_like(EVERYWHERE)
INNER[32:-32, 32:-32] = True


def to_image(values):
    return np.repeat(np.rint(255 * values)[..., None], 3, axis=2).astype(np.uint8)


def wave(period, amplitude=0.4):
    return 0.5 + amplitude * np.sin(2 * np.pi * (np.arange(256) + 0.25) / period) * np.ones((256, 1))


def test_a_ramp_has_its_squared_slope():
    x, y = np.meshgrid(np.arange(256), np.arange(256))
    image = np.stack([x, x, 255 - y], axis=2).astype(np.uint8)  # one level per pixel, in each channel
    assert gradient_energy(image, INNER) == pytest.approx(1 / 255**2, rel=1e-5)


def test_an_image_is_as_sharp_as_itself():
    image = to_image(np.random.default_rng(0).random((256, 256)))
    assert sharpness(image, INNER, image, INNER) == 1


def test_white_noise_loses_what_the_gaussian_takes():
    # Of white noise of variance v, the filter h leaves v |h|^2: |h|^2 is 1/4 + 1/4 for central differences, and
    # 1 / (8 pi s^4) for the derivative of a Gaussian of deviation s, along each axis.
    sigma = 2.0
    noise = 0.5 + np.clip(0.12 * np.random.default_rng(0).normal(size=(256, 256)), -0.5, 0.5)
    blurred = cv2.GaussianBlur(noise, (0, 0), sigma)
    contrast = 8  # so that rounding to 8 bits adds little; the energy grows by its square
    measured = sharpness(to_image(0.5 + contrast * (blurred - 0.5)), INNER, to_image(noise), INNER) / contrast**2
    assert measured == pytest.approx(1 / (8 * np.pi * sigma**4) / 0.5, rel=0.15)


@pytest.mark.parametrize("sigma", [1.0, 2.0, 3.0])
def test_a_wave_keeps_the_square_of_the_gaussians_transfer_function(sigma):
    period = 16
    sharp = wave(period)
    blurred = cv2.GaussianBlur(sharp, (0, 0), sigma)
    expected = np.exp(-((2 * np.pi / period * sigma) ** 2))
    assert sharpness(to_image(blurred), INNER, to_image(sharp), INNER) == pytest.approx(expected, rel=0.03)


def test_only_the_region_counts():
    image = to_image(wave(16))
    changed = image.copy()
    changed[:20] = np.random.default_rng(0).integers(0, 256, (20, 256, 3))
    assert gradient_energy(changed, INNER) == gradient_energy(image, INNER)
    assert gradient_energy(changed, EVERYWHERE) > gradient_energy(image, EVERYWHERE)


def test_regions_of_both_images_may_differ():
    image = to_image(wave(16))
    shifted = np.roll(image, 16, axis=1)
    left, right = np.zeros_like(EVERYWHERE), np.zeros_like(EVERYWHERE)
    left[:, 48:80], right[:, 64:96] = True, True
    assert sharpness(shifted, right, image, left) == pytest.approx(1)


def test_without_pixels_or_gradients_there_is_no_value():
    image = to_image(wave(16))
    assert np.isnan(gradient_energy(image, np.zeros_like(EVERYWHERE)))
    assert np.isnan(sharpness(image, INNER, np.zeros_like(image), INNER))
