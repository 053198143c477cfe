"""PSNR and SSIM: closed forms, invariances, an independent dense convolution."""

import numpy as np
import pytest
from scipy.signal import convolve2d

from evaluation.metrics import image_quality
from evaluation.metrics.image_quality import psnr, region_mean, ssim_map


@pytest.fixture
def pair():
    generator = np.random.default_rng(0)
    image = generator.random((23, 31, 3))
    return image, np.clip(image + generator.normal(0, 0.1, image.shape), 0, 1)


@pytest.mark.parametrize("difference", [0.5, 0.1, 1 / 255])
def test_psnr_of_a_constant_difference_is_minus_20_log10_of_it(difference):
    image = np.full((5, 7, 3), 0.25)
    assert psnr(image + difference, image) == pytest.approx(-20 * np.log10(difference))


def test_psnr_of_identical_images_is_infinite_and_of_an_empty_region_undefined(pair):
    assert psnr(pair[0], pair[0]) == np.inf
    assert np.isnan(psnr(*pair, np.zeros((23, 31), bool)))


def test_psnr_of_a_rectangle_is_the_psnr_of_the_cut_out_images(pair):
    region = np.zeros((23, 31), bool)
    region[4:10, 6:20] = True
    assert psnr(*pair, region) == pytest.approx(psnr(pair[0][4:10, 6:20], pair[1][4:10, 6:20]))


def test_psnr_of_a_region_ignores_what_lies_outside(pair):
    region = np.zeros((23, 31), bool)
    region[4:10, 6:20] = True
    elsewhere = np.where(region[..., None], pair[0], 0)
    assert psnr(elsewhere, pair[1], region) == psnr(*pair, region)


def test_squared_errors_of_complementary_regions_add_up(pair):
    region = np.random.default_rng(1).random((23, 31)) < 0.3
    pooled = region.mean() * 10 ** (-psnr(*pair, region) / 10) + (~region).mean() * 10 ** (-psnr(*pair, ~region) / 10)
    assert pooled == pytest.approx(10 ** (-psnr(*pair) / 10))


def test_ssim_of_an_image_with_itself_is_one(pair):
    np.testing.assert_allclose(ssim_map(pair[0], pair[0]), 1, atol=1e-12)


def test_ssim_is_symmetric(pair):
    np.testing.assert_allclose(ssim_map(*pair), ssim_map(*pair[::-1]), atol=1e-13)


def test_ssim_of_constant_images_is_their_luminance_term():
    # Far from the border, where the window sees only the constants a and b: variances are 0.
    a, b, c1 = 0.2, 0.7, 1e-4
    found = ssim_map(np.full((21, 21, 3), a), np.full((21, 21, 3), b))
    assert found[10, 10] == pytest.approx((2 * a * b + c1) / (a * a + b * b + c1), rel=1e-9)


def test_ssim_agrees_with_a_dense_zero_padded_convolution(pair):
    offsets = np.arange(-5, 6)
    window = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * 1.5**2))
    window /= window.sum()

    def blur(channel):
        return convolve2d(channel, window, mode="same", boundary="fill", fillvalue=0)

    maps = []
    for x, y in zip(pair[0].transpose(2, 0, 1), pair[1].transpose(2, 0, 1), strict=True):
        mx, my = blur(x), blur(y)
        vx, vy, cov = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
        maps.append((2 * mx * my + 1e-4) * (2 * cov + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4)))
    np.testing.assert_allclose(ssim_map(*pair), np.mean(maps, axis=0), atol=1e-12)


def test_region_mean_weights_regions_by_their_size(pair):
    similarity = ssim_map(*pair)
    region = np.random.default_rng(1).random((23, 31)) < 0.3
    parts = region.mean() * region_mean(similarity, region) + (~region).mean() * region_mean(similarity, ~region)
    assert parts == pytest.approx(region_mean(similarity))
    assert np.isnan(region_mean(similarity, np.zeros_like(region)))


@pytest.mark.parametrize("patch", [(0, 0, 1, 1), (9, 14, 3, 5), (18, 25, 5, 6), (0, 12, 23, 2)])
def test_ssim_of_images_that_agree_outside_a_patch_is_that_of_all_windows(patch, pair):
    """Windows without a difference are skipped; the result is the same number up to rounding."""
    row, column, height, width = patch
    image, truth = pair[0].copy(), pair[0]
    image[row : row + height, column : column + width] = pair[1][row : row + height, column : column + width]
    np.testing.assert_allclose(ssim_map(image, truth), image_quality._ssim(image, truth), rtol=0, atol=1e-14)
    assert (ssim_map(truth, truth) == 1).all()
