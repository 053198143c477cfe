"""Stable Diffusion as a denoiser of images: autoencoder, U-Net, noise schedule, and an embedded empty prompt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, UInt8

from carigs.weights.diffusers_parts import load_parts
from carigs.weights.registry import registered
from evaluation.metrics.networks.preprocessing import Preprocessing

if TYPE_CHECKING:
    import torch

IMAGE_SIZE = 512
"""Height and width of the network's images in pixels."""
HALVES = (0.5, 0.5, 0.5)  # mean and deviation that take [0, 1] to [-1, 1]


@dataclass(frozen=True)
class DiffusionModel:
    """A Stable Diffusion model for the empty prompt and without guidance."""

    vae: Any
    unet: Any
    prompt: torch.Tensor
    """Embedding of the empty prompt (1, tokens, d)."""
    alphas_cumprod: Float[np.ndarray, " s"]
    """Share of the image in the variance at each timestep."""
    prediction_type: str
    """`epsilon` if the network predicts the noise, `v_prediction` if it predicts sqrt(a) eps - sqrt(1 - a) z."""

    @property
    def latent_scale(self) -> float:
        """Factor of the latents, from the configuration of the autoencoder."""
        return self.vae.config.scaling_factor

    def encode(self, image: UInt8[np.ndarray, "h w 3"], background: int = 255) -> torch.Tensor:
        """Encode an image, padded to a square and scaled to `IMAGE_SIZE`.

        Args:
            image: RGB values from 0 to 255.
            background: Grey value of the padding, from 0 to 255.

        Returns:
            Mode of the autoencoder's distribution, shifted and scaled as its configuration says (c, h, w).
        """
        import torch

        pixels = Preprocessing(HALVES, HALVES, "pad_square", background, IMAGE_SIZE)(image)
        with torch.inference_mode():
            latent = self.vae.encode(pixels[None].to(self.prompt.device)).latent_dist.mode()[0]
        return (latent - (self.vae.config.shift_factor or 0)) * self.latent_scale

    def predict_noise(self, noisy: torch.Tensor, timestep: int) -> torch.Tensor:
        """Predict the noise in noisy latents.

        Args:
            noisy: x_t = sqrt(a) z + sqrt(1 - a) eps (b, c, h, w).
            timestep: Timestep t.

        Returns:
            Prediction of eps (b, c, h, w).
        """
        import torch

        with torch.inference_mode():
            prompts = self.prompt.expand(len(noisy), -1, -1)
            output = self.unet(noisy, timestep, encoder_hidden_states=prompts).sample
        if self.prediction_type == "epsilon":
            return output
        share = float(self.alphas_cumprod[timestep])
        return share**0.5 * output + (1 - share) ** 0.5 * noisy


def load_diffusion_model(folder: Path, device: str = "cpu") -> DiffusionModel:
    """Load a Stable Diffusion model in float32: safetensors and tables, no code.

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
    parts = load_parts(folder, registered("stable_diffusion_1.5"), [""], device)
    return DiffusionModel(parts.vae, parts.unet, parts.prompts, parts.alphas_cumprod, parts.prediction_type)
