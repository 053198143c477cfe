"""Samplers of diffusion models that edit: noise is added to an image, and removed again under guidance."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    import torch


def denoise_from(
    latents: torch.Tensor,
    noise: torch.Tensor,
    predict: Callable[[torch.Tensor, int], torch.Tensor],
    alphas_cumprod: Float[np.ndarray, " s"],
    start: int,
    steps: int,
) -> torch.Tensor:
    """Add noise to latents, and remove it by DDIM without randomness (Song et al. 2021, equation 12 with sigma = 0).

        x_t = sqrt(a_t) z + sqrt(1 - a_t) eps
        z'  = (x_t - sqrt(1 - a_t) eps_theta(x_t, t)) / sqrt(a_t)
        x_s = sqrt(a_s) z' + sqrt(1 - a_s) eps_theta(x_t, t)        for the next time s < t; z' itself after the last

    Args:
        latents: Latents z of the image.
        noise: Noise eps of the same shape.
        predict: Prediction eps_theta of the noise in x_t at a time t.
        alphas_cumprod: Share a_t of the image in the variance at each time.
        start: The first time t.
        steps: Number of steps; at most one for each time.

    Returns:
        Latents of the edited image.
    """
    times = np.unique(np.linspace(start, 0, min(steps, start) + 1).round().astype(int)[:-1])[::-1]
    share = float(alphas_cumprod[start])
    x = share**0.5 * latents + (1 - share) ** 0.5 * noise
    for t, following in zip(times, [*times[1:], None], strict=True):
        share, predicted = float(alphas_cumprod[t]), predict(x, int(t))
        clean = (x - (1 - share) ** 0.5 * predicted) / share**0.5
        if following is None:
            break
        share = float(alphas_cumprod[following])
        x = share**0.5 * clean + (1 - share) ** 0.5 * predicted
    return clean


def guided(
    full: torch.Tensor, image_only: torch.Tensor, unconditional: torch.Tensor, text_scale: float, image_scale: float
) -> torch.Tensor:
    """Guidance by a text and an image (Brooks et al. 2023, equation 3).

    Args:
        full: Prediction for the text and the image.
        image_only: Prediction for the image and the empty text.
        unconditional: Prediction for neither.
        text_scale: Scale of the text.
        image_scale: Scale of the image.

    Returns:
        unconditional + image_scale (image_only - unconditional) + text_scale (full - image_only).
    """
    return unconditional + image_scale * (image_only - unconditional) + text_scale * (full - image_only)
