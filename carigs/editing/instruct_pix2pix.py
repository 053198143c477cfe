"""InstructPix2Pix (Brooks et al. 2023): Stable Diffusion that has learned to follow instructions on an image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from carigs.editing.guided_sampling import guided
from carigs.editing.latent_editor import LatentEditor, Prediction
from carigs.errors import InputError
from carigs.settings import Edit
from carigs.weights.diffusers_parts import load_parts
from carigs.weights.registry import registered
from carigs.weights.search import find_weights

if TYPE_CHECKING:
    import torch

WEIGHTS = "instruct_pix2pix"


class InstructPix2Pix(LatentEditor):
    """Edits the rendered view under guidance by the prompt and the captured image."""

    def prepare(self, captured: Float32[np.ndarray, "h w 3"]) -> Prediction:
        """Encode the captured image.

        Args:
            captured: The image that conditions the edit.

        Returns:
            Function from noisy latents and the time to the guided output of the network.
        """
        import torch

        condition = self.encode(captured)  # unscaled, as the network was trained
        conditions = torch.cat([condition, condition, torch.zeros_like(condition)])
        text, empty = self.parts.prompts[:1], self.parts.prompts[1:]
        texts = torch.cat([text, empty, empty])

        def predict(x: torch.Tensor, t: int) -> torch.Tensor:
            full = torch.cat([x.expand(3, -1, -1, -1), conditions], dim=1)
            outputs = self.parts.unet(full, t, encoder_hidden_states=texts).sample.chunk(3)
            return guided(*outputs, self.settings.text_guidance, self.settings.image_guidance)

        return predict


def load_instruct_pix2pix(settings: Edit, background: float) -> InstructPix2Pix:
    """Load the network.

    Args:
        settings: Section `train.edit`.
        background: Grey value that pads images to squares.

    Returns:
        The editor.

    Raises:
        WeightsMissing: Its weights or diffusers are missing.
        InputError: A file is not valid, or is of another network.
    """
    weights = registered(WEIGHTS)
    folder = find_weights(weights, None)
    parts = load_parts(folder, weights, [settings.prompt, ""])
    channels = parts.unet.config.in_channels
    if channels != 2 * parts.vae.config.latent_channels:
        problem = f"{channels} channels, of which an editor needs {2 * parts.vae.config.latent_channels}"
        raise InputError(f"{problem}: it is another network", file=folder / "unet/config.json", field="in_channels")
    return InstructPix2Pix(parts, settings, background)
