"""Stable Diffusion with the ControlNet that has learned instructions on an image (Zhang et al. 2023)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32

from carigs.editing.guided_sampling import guided
from carigs.editing.latent_editor import LatentEditor, Prediction
from carigs.errors import InputError
from carigs.settings import Edit
from carigs.weights.diffusers_parts import DiffusionParts, load_network, load_parts
from carigs.weights.registry import registered
from carigs.weights.search import find_weights

if TYPE_CHECKING:
    import torch

BASE, WEIGHTS = "stable_diffusion_1.5", "controlnet_ip2p"


class ControlNetEditor(LatentEditor):
    """Edits the rendered view under guidance by the prompt; the captured image steers the network by its ControlNet.

    Args:
        parts: Stable Diffusion.
        control: The ControlNet.
        settings: Section `train.edit`.
        background: Grey value that pads images to squares.
    """

    def __init__(self, parts: DiffusionParts, control: Any, settings: Edit, background: float) -> None:
        super().__init__(parts, settings, background)
        self.control = control

    def prepare(self, captured: Float32[np.ndarray, "h w 3"]) -> Prediction:
        """Prepare the captured image.

        Args:
            captured: The image that conditions the edit.

        Returns:
            Function from noisy latents and the time to the guided output of the network.
        """
        condition = self.pixels(captured).expand(2, -1, -1, -1)
        texts = self.parts.prompts

        def predict(x: torch.Tensor, t: int) -> torch.Tensor:
            both = x.expand(2, -1, -1, -1)
            down, middle = self.control(both, t, texts, condition, return_dict=False)
            text, empty = self.parts.unet(
                both, t, encoder_hidden_states=texts, down_block_additional_residuals=down,
                mid_block_additional_residual=middle,
            ).sample.chunk(2)  # fmt: skip
            return guided(text, empty, empty, self.settings.text_guidance, 0.0)

        return predict


def load_controlnet_ip2p(settings: Edit, background: float) -> ControlNetEditor:
    """Load both networks.

    Args:
        settings: Section `train.edit`.
        background: Grey value that pads images to squares.

    Returns:
        The editor.

    Raises:
        WeightsMissing: Weights or diffusers are missing.
        InputError: A file is not valid, or the two networks do not fit each other.
    """
    entry, weights = registered(BASE), registered(WEIGHTS)
    folder, control_folder = find_weights(entry, None), find_weights(weights, None)
    parts = load_parts(folder, entry, [settings.prompt, ""])
    from diffusers import ControlNetModel

    control = load_network(ControlNetModel, control_folder, weights.title, low_cpu_mem_usage=False)
    for name in ("in_channels", "cross_attention_dim", "block_out_channels"):
        if (theirs := control.config[name]) != (ours := parts.unet.config[name]):
            problem = f"{theirs}, that of {entry.title} is {ours}"
            raise InputError(problem, file=control_folder / "config.json", field=name)
    return ControlNetEditor(parts, control.to(parts.device), settings, background)
