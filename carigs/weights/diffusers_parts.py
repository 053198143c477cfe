"""Parts of diffusion models in the folders of diffusers: safetensors and tables, no code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError, WeightsMissing
from carigs.weights.offline import work_offline
from carigs.weights.registry import Weights

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class DiffusionParts:
    """A latent diffusion model in float32."""

    vae: Any
    unet: Any
    prompts: torch.Tensor
    """Embeddings of the prompts (p, tokens, d)."""
    alphas_cumprod: Float[np.ndarray, " s"]
    """Share of the image in the variance at each timestep."""
    prediction_type: str
    """`epsilon` if the network predicts the noise, `v_prediction` if it predicts sqrt(a) eps - sqrt(1 - a) z."""

    @property
    def latent_scale(self) -> float:
        """Factor of the latents, from the configuration of the autoencoder."""
        return self.vae.config.scaling_factor

    @property
    def device(self) -> torch.device:
        """Where the networks are."""
        return self.prompts.device

    def noise(self, output: torch.Tensor, noisy: torch.Tensor, timestep: int) -> torch.Tensor:
        """The noise that an output of the network stands for.

        Args:
            output: Of the network, as `prediction_type` says (b, c, h, w).
            noisy: x_t = sqrt(a) z + sqrt(1 - a) eps (b, c, h, w).
            timestep: Timestep t.

        Returns:
            Prediction of eps (b, c, h, w).
        """
        if self.prediction_type == "epsilon":
            return output
        share = float(self.alphas_cumprod[timestep])
        return share**0.5 * output + (1 - share) ** 0.5 * noisy


def load_parts(folder: Path, weights: Weights, prompts: Sequence[str], device: str | None = None) -> DiffusionParts:
    """Load a diffusion model: safetensors and tables, no code.

    Args:
        folder: Model in the layout of diffusers.
        weights: Its entry of the registry: the files that must be there, and its title.
        prompts: Texts to embed.
        device: PyTorch's name of the device; None for a GPU if there is one.

    Returns:
        The model.

    Raises:
        WeightsMissing: diffusers is not installed.
        InputError: A file is missing or cannot be read, parameters are missing, or the network predicts neither noise
            nor v.
    """
    for file in weights.files:
        if not (folder / file.name).is_file():
            raise InputError(f"has no file {file.name}", file=folder)
    work_offline()
    import torch

    try:
        from diffusers import AutoencoderKL, DDPMScheduler, UNet2DConditionModel
        from transformers import CLIPTextModel, CLIPTokenizer
    except ImportError as error:
        raise WeightsMissing(f"{error.name} is not installed: pip install 'carigs[diffusion]'") from error

    what = weights.title
    unet = load_network(UNet2DConditionModel, folder / "unet", what, low_cpu_mem_usage=False)
    vae = load_network(AutoencoderKL, folder / "vae", what, low_cpu_mem_usage=False)
    text_encoder = load_network(CLIPTextModel, folder / "text_encoder", what)
    try:
        scheduler = DDPMScheduler.from_pretrained(folder / "scheduler", local_files_only=True)
        tokenizer = CLIPTokenizer.from_pretrained(folder / "tokenizer", local_files_only=True)
        length = text_encoder.config.max_position_embeddings
        tokens = tokenizer(
            list(prompts), padding="max_length", max_length=length, truncation=True, return_tensors="pt"
        ).input_ids
        with torch.inference_mode():
            embedded = text_encoder(tokens).last_hidden_state
    except Exception as error:  # a damaged file can fail anywhere
        raise unreadable(folder, what, error) from error
    kind = scheduler.config.prediction_type
    if kind not in ("epsilon", "v_prediction"):
        problem = f"{kind} is unknown; the network must predict epsilon or v_prediction"
        raise InputError(problem, file=folder / "scheduler/scheduler_config.json", field="prediction_type")
    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    shares = scheduler.alphas_cumprod.double().numpy()
    return DiffusionParts(vae.to(device), unet.to(device), embedded.to(device), shares, kind)


def load_network(network: Any, folder: Path, what: str, **options: Any) -> torch.nn.Module:
    """Load a network in float32.

    Args:
        network: Its class in diffusers or transformers.
        folder: Folder with its configuration and its .safetensors file.
        what: Name of the model, for error messages.
        **options: More arguments of `from_pretrained`.

    Returns:
        The network, in evaluation mode.

    Raises:
        InputError: A file cannot be read, or parameters are missing.
    """
    try:
        model, report = network.from_pretrained(
            folder, local_files_only=True, use_safetensors=True, output_loading_info=True, **options
        )
    except Exception as error:  # a damaged file can fail anywhere
        raise unreadable(folder, what, error) from error
    missing = sorted(report["missing_keys"])  # the libraries fill these with random numbers
    if missing:
        raise InputError(f"{len(missing)} parameters are missing, such as {missing[0]}", file=folder)
    return model.float().eval()


def unreadable(folder: Path, what: str, error: Exception) -> InputError:
    """The error of a part that cannot be read.

    Args:
        folder: Its folder.
        what: Name of the model.
        error: What the library says.

    Returns:
        An error of one line.
    """
    problem = " ".join(str(error).split())[:160]
    return InputError(f"not a readable part of {what} ({type(error).__name__}: {problem})", file=folder)
