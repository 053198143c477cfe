"""The sampler of edits in closed form, and guidance."""

import numpy as np
import pytest
import torch

from carigs.editing.guided_sampling import denoise_from, guided

SCHEDULE = np.cumprod(1 - np.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2)  # of Stable Diffusion
LATENTS, NOISE, OTHER = torch.randn((3, 1, 4, 8, 8), generator=torch.Generator().manual_seed(7), dtype=torch.float64)
CASES = pytest.mark.parametrize(("start", "steps"), [(979, 20), (500, 20), (20, 20), (7, 20), (1, 1), (999, 1000)])


def towards(clean):
    """A denoiser that takes `clean` for the image behind whatever it sees."""

    def predict(x, t):
        return (x - SCHEDULE[t] ** 0.5 * clean) / (1 - SCHEDULE[t]) ** 0.5

    return predict


@CASES
def test_a_denoiser_that_knows_the_image_gives_it_back(start, steps):
    found = denoise_from(LATENTS, NOISE, towards(LATENTS), SCHEDULE, start, steps)
    torch.testing.assert_close(found, LATENTS)


@CASES
def test_a_denoiser_that_sees_another_image_ends_there(start, steps):
    found = denoise_from(LATENTS, NOISE, towards(OTHER), SCHEDULE, start, steps)
    torch.testing.assert_close(found, OTHER)


@CASES
def test_a_denoiser_that_always_predicts_the_noise_that_was_added_changes_nothing(start, steps):
    torch.testing.assert_close(denoise_from(LATENTS, NOISE, lambda x, t: NOISE, SCHEDULE, start, steps), LATENTS)


def test_the_first_noisy_image_has_the_share_of_its_time_and_times_fall_evenly():
    seen = []

    def predict(x, t):
        seen.append((t, x))
        return NOISE

    denoise_from(LATENTS, NOISE, predict, SCHEDULE, 700, 20)
    t, x = seen[0]
    assert t == 700 and len(seen) == 20
    torch.testing.assert_close(x, SCHEDULE[700] ** 0.5 * LATENTS + (1 - SCHEDULE[700]) ** 0.5 * NOISE)
    steps = -np.diff([t for t, _ in seen])
    assert steps.min() == steps.max() == 35


def test_little_noise_stays_near_the_image_whatever_the_denoiser_sees():
    """One step from time t with the noise forgotten: the error is that of the noise, sqrt((1 - a) / a)."""
    found = denoise_from(LATENTS, NOISE, lambda x, t: 0 * x, SCHEDULE, 20, 1)
    torch.testing.assert_close(found - LATENTS, ((1 - SCHEDULE[20]) / SCHEDULE[20]) ** 0.5 * NOISE)


def test_guidance_is_one_of_its_parts_at_scales_of_zero_and_one():
    full, image, none = torch.randn((3, 5), generator=torch.Generator().manual_seed(1))
    for scales, expected in (((1, 1), full), ((0, 1), image), ((0, 0), none), ((1, 0), none + full - image)):
        torch.testing.assert_close(guided(full, image, none, *scales), expected)
    # The text's direction alone grows with its scale.
    more = guided(full, image, none, 8.5, 1.5) - guided(full, image, none, 7.5, 1.5)
    torch.testing.assert_close(more, full - image, atol=1e-5, rtol=1e-5)
