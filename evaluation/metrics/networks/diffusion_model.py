"""Stable Diffusion as a denoiser of images, for the empty prompt and without guidance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from carigs.weights.diffusers_parts import DiffusionParts, load_parts
from carigs.weights.registry import registered
from evaluation.metrics.networks.preprocessing import Preprocessing

if TYPE_CHECKING:
    import torch

IMAGE_SIZE = 512
"""Height and width of the network's images in pixels."""
HALVES = (0.5, 0.5, 0.5)  # mean and deviation that take [0, 1] to [-1, 1]


def load_diffusion_model(folder: Path, device: str = "cpu") -> DiffusionParts:
    """Load a Stable Diffusion model with the empty prompt: safetensors and tables, no code.

    Args:
        folder: Model in the layout of diffusers, with the files that the registry of weights lists.
        device: PyTorch's name of the device to compute on.

    Returns:
        The model.

    Raises:
        WeightsMissing: diffusers is not installed.
        InputError: A file is missing or cannot be read, parameters are missing, or the network predicts neither noise
            nor v.
    """
    return load_parts(folder, registered("stable_diffusion_1.5"), [""], device)


def encode(model: DiffusionParts, image: UInt8[np.ndarray, "h w 3"], background: int = 255) -> torch.Tensor:
    """Encode an image, padded to a square and scaled to `IMAGE_SIZE`.

    Args:
        model: The model.
        image: RGB values from 0 to 255.
        background: Grey value of the padding, from 0 to 255.

    Returns:
        Mode of the autoencoder's distribution, shifted and scaled as its configuration says (c, h, w).
    """
    import torch

    pixels = Preprocessing(HALVES, HALVES, "pad_square", background, IMAGE_SIZE)(image)
    with torch.inference_mode():
        latent = model.vae.encode(pixels[None].to(model.device)).latent_dist.mode()[0]
    return (latent - (model.vae.config.shift_factor or 0)) * model.latent_scale


def predict_noise(model: DiffusionParts, noisy: torch.Tensor, timestep: int) -> torch.Tensor:
    """Predict the noise in noisy latents.

    Args:
        model: The model, with one prompt.
        noisy: x_t = sqrt(a) z + sqrt(1 - a) eps (b, c, h, w).
        timestep: Timestep t.

    Returns:
        Prediction of eps (b, c, h, w).
    """
    import torch

    with torch.inference_mode():
        prompts = model.prompts.expand(len(noisy), -1, -1)
        output = model.unet(noisy, timestep, encoder_hidden_states=prompts).sample
    return model.noise(output, noisy, timestep)
