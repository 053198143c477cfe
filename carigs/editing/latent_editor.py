"""What editors by latent diffusion share: images to latents and back, and the noise of an edit."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from carigs.editing.guided_sampling import denoise_from
from carigs.editing.square_images import from_square, to_square
from carigs.editing.view import ViewToEdit
from carigs.settings import Edit
from carigs.weights.diffusers_parts import DiffusionParts

if TYPE_CHECKING:
    import torch

Prediction = Callable[["torch.Tensor", int], "torch.Tensor"]
"""From noisy latents and the time to the guided output of a network."""
LEAST_NOISE = 0.02
"""Share of the schedule that every edit adds at least (Haque et al. 2023)."""


class LatentEditor(ABC):
    """Adds noise to the latents of the rendered view and removes it; subclasses predict the noise.

    Args:
        parts: The diffusion model, with the embeddings of the prompt and of the empty text.
        settings: Section `train.edit`.
        background: Grey value that pads images to squares.
    """

    def __init__(self, parts: DiffusionParts, settings: Edit, background: float) -> None:
        self.parts, self.settings, self.background = parts, settings, background
        levels = len(parts.vae.config.block_out_channels) - 1
        self.size = parts.unet.config.sample_size * 2**levels
        """Height and width of the network's images: 512 of Stable Diffusion 1.5."""

    def __call__(self, view: ViewToEdit) -> Float32[np.ndarray, "h w 3"]:
        """Edit a view.

        Args:
            view: The view.

        Returns:
            Its new image in [0, 1].
        """
        import torch

        generator = torch.Generator().manual_seed(_seed(view.seed))
        last = len(self.parts.alphas_cumprod) - 1
        share = LEAST_NOISE + (self.settings.noise - LEAST_NOISE) * torch.rand((), generator=generator).item()
        with torch.inference_mode():
            latents = self.encode(view.rendered) * self.parts.latent_scale
            noise = torch.randn(latents.shape, generator=generator).to(latents)
            predict = self.prepare(view.captured)
            edited = denoise_from(
                latents, noise, lambda x, t: self.parts.noise(predict(x, t), x, t), self.parts.alphas_cumprod,
                max(1, round(share * last)), self.settings.steps,
            )  # fmt: skip
            return self.decode(edited, view.rendered.shape[:2])

    @abstractmethod
    def prepare(self, captured: Float32[np.ndarray, "h w 3"]) -> Prediction:
        """Prepare the prediction for a captured image.

        Args:
            captured: The image that conditions the edit.

        Returns:
            Function from noisy latents and the time to the guided output of the network.
        """

    def pixels(self, image: Float32[np.ndarray, "h w 3"]) -> torch.Tensor:
        """Bring an image to the network's size: padded to a square, then scaled.

        Args:
            image: RGB in [0, 1].

        Returns:
            The same in (1, 3, size, size).
        """
        import torch

        square = to_square(image, self.size, self.background)
        return torch.from_numpy(square).permute(2, 0, 1)[None].to(self.parts.device)

    def encode(self, image: Float32[np.ndarray, "h w 3"]) -> torch.Tensor:
        """Encode an image.

        Args:
            image: RGB in [0, 1].

        Returns:
            Mode of the autoencoder's distribution, not scaled (1, c, h, w).
        """
        return self.parts.vae.encode(2 * self.pixels(image) - 1).latent_dist.mode()

    def decode(self, latents: torch.Tensor, shape: tuple[int, int]) -> Float32[np.ndarray, "h w 3"]:
        """Decode latents to an image of the size that it had before `encode`.

        Args:
            latents: Scaled latents (1, c, h, w).
            shape: Height and width.

        Returns:
            RGB in [0, 1].
        """
        image = self.parts.vae.decode(latents / self.parts.latent_scale).sample[0]
        square = (0.5 + 0.5 * image).clamp(0, 1).permute(1, 2, 0).cpu().numpy()
        return from_square(square, shape)


def _seed(seed: tuple[int, ...]) -> int:
    """One number of several."""
    return int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0] >> 1)
