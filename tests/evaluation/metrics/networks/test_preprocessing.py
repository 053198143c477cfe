"""Network input: open_clip's own pipeline, and padding instead of its crop."""

import numpy as np
import pytest

from evaluation.metrics.networks import clip, dino
from evaluation.metrics.networks.preprocessing import Preprocessing

PLAIN = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def noise(shape):
    return np.random.default_rng(0).integers(0, 256, (*shape, 3)).astype(np.uint8)


@pytest.mark.parametrize("statistics", [clip.STATISTICS, dino.STATISTICS])
@pytest.mark.parametrize("shape", [(802, 550), (80, 55), (55, 80), (64, 64), (401, 275), (300, 225)])
def test_the_centre_crop_is_open_clips_own_pipeline(shape, statistics):
    from open_clip.transform import image_transform
    from PIL import Image

    mean, deviation = statistics
    reference = image_transform(224, is_train=False, mean=mean, std=deviation)(Image.fromarray(noise(shape)))
    found = Preprocessing(*statistics)(noise(shape))
    assert found.shape == reference.shape == (3, 224, 224)
    assert float((found - reference).abs().max()) < 0.05
    assert float((found - reference).abs().mean()) < 1e-3


def test_padding_keeps_all_of_a_portrait_and_fills_with_the_background():
    found = Preprocessing(*PLAIN, "pad_square", background=51, size=32)(np.zeros((80, 40, 3), np.uint8))
    assert found.shape == (3, 32, 32)
    assert float(found[:, :, 10:22].abs().max()) == 0  # away from the seam
    np.testing.assert_allclose(found[:, :, :6], 0.2, atol=1e-6)
    np.testing.assert_allclose(found[:, :, -6:], 0.2, atol=1e-6)


def test_a_square_image_is_not_padded():
    padded, cropped = (
        Preprocessing(*clip.STATISTICS, crop, size=32)(noise((50, 50))) for crop in ("pad_square", "center")
    )
    np.testing.assert_array_equal(padded, cropped)


@pytest.mark.parametrize("crop", ["center", "pad_square"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (500, 3)])
def test_images_of_every_shape_have_an_input(shape, crop):
    found = Preprocessing(*clip.STATISTICS, crop, size=16)(noise(shape))
    assert found.shape == (3, 16, 16) and bool(found.isfinite().all())


def test_an_image_that_cannot_be_written_to_is_left_alone():
    image = noise((20, 30))
    before = image.copy()
    image.flags.writeable = False
    Preprocessing(*clip.STATISTICS, size=16)(image)
    np.testing.assert_array_equal(image, before)
