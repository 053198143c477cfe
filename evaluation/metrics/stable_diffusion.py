"""SD score of table 1 (equation 10): how well Stable Diffusion predicts the noise in noisy versions of a frame."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from evaluation.metrics.preprocessing import preprocess

if TYPE_CHECKING:
    import torch

TIMESTEPS = tuple(int(t) for t in np.round(np.linspace(20, 980, 10)))
"""The range of DreamFusion (Poole et al. 2022), 0.02 to 0.98 of 1000 steps. The paper does not state its own."""
SEEDS = (0, 1, 2, 3)
IMAGE_SIZE = 512
"""Height and width in pixels of the network's images."""
STATISTICS = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))  # from [0, 1] to [-1, 1]
NETWORK_FILES = {
    "unet": ("config.json", "diffusion_pytorch_model.safetensors"),
    "vae": ("config.json", "diffusion_pytorch_model.safetensors"),
    "text_encoder": ("config.json", "model.safetensors"),
    "tokenizer": ("vocab.json", "merges.txt", "tokenizer_config.json"),
    "scheduler": ("scheduler_config.json",),
}
"""Files of a model folder that are read: weights and tables, no code."""


def sd_score(
    denoiser: Callable[[torch.Tensor, int], torch.Tensor],
    latents: torch.Tensor,
    timesteps: Sequence[int],
    seeds: Sequence[int],
    alphas_cumprod: Float[np.ndarray, " s"],
) -> Float[np.ndarray, " b"]:
    """SD score of images (equation 10).

        SD = 1 - mean over t, n of |eps_theta(x_t, t) - eps|^2 / |eps|^2,  x_t = sqrt(a_t) z + sqrt(1 - a_t) eps

    The noise eps depends on the seed n and the timestep t alone: all images of all methods are measured with the same.

    Args:
        denoiser: Noise eps_theta that is predicted from a batch x_t (b, c, h, w) at a timestep.
        latents: Latents z of the images (b, c, h, w).
        timesteps: Timesteps t, indices of `alphas_cumprod`.
        seeds: Seeds of the noise.
        alphas_cumprod: Share a_t of the image's variance at each timestep.

    Returns:
        Score of each image: 1 if the noise is predicted exactly, 0 for a prediction of zero. Their mean is the paper's.
    """
    import torch

    ratios = []
    for t in timesteps:
        share = float(alphas_cumprod[t])
        for seed in seeds:
            generator = torch.Generator().manual_seed(len(alphas_cumprod) * seed + t)
            noise = torch.randn(latents.shape[1:], generator=generator).to(latents)
            predicted = denoiser(share**0.5 * latents + (1 - share) ** 0.5 * noise, t)
            errors = (predicted - noise).double().square().sum(dim=(1, 2, 3))
            ratios.append(errors / noise.double().square().sum())
    return 1 - torch.stack(ratios).mean(dim=0).cpu().numpy()


@dataclass(frozen=True)
class StableDiffusion:
    """Encoder, denoiser and noise schedule of a Stable Diffusion model, for the empty prompt and without guidance."""

    vae: Any
    unet: Any
    prompt: torch.Tensor
    """Embedding of the empty prompt (1, tokens, d)."""
    alphas_cumprod: Float[np.ndarray, " s"]
    prediction_type: str
    """`epsilon` if the network predicts the noise, `v_prediction` if it predicts sqrt(a) eps - sqrt(1 - a) z."""

    def encode(self, image: Float[np.ndarray, "h w 3"], background: float = 1.0) -> torch.Tensor:
        """Encode an image, padded to a square and scaled to `IMAGE_SIZE`.

        Args:
            image: Image with values in [0, 1].
            background: Grey value of the padding.

        Returns:
            Mode of the encoder's distribution, shifted and scaled as the denoiser expects (c, h, w).
        """
        import torch

        pixels = preprocess(image, IMAGE_SIZE, STATISTICS, "pad_square", background)
        with torch.inference_mode():
            latent = self.vae.encode(pixels[None].to(self.vae.device)).latent_dist.mode()[0]
        return (latent - (self.vae.config.shift_factor or 0)) * self.vae.config.scaling_factor

    def predict_noise(self, noisy: torch.Tensor, timestep: int) -> torch.Tensor:
        """Predict the noise.

        Args:
            noisy: Noisy latents x_t (b, c, h, w).
            timestep: Timestep t.

        Returns:
            eps_theta(x_t, t), (b, c, h, w).
        """
        import torch

        prompts = self.prompt.expand(len(noisy), -1, -1)
        with torch.inference_mode():
            output = self.unet(noisy, timestep, encoder_hidden_states=prompts).sample
        if self.prediction_type == "epsilon":
            return output
        share = float(self.alphas_cumprod[timestep])
        return share**0.5 * output + (1 - share) ** 0.5 * noisy

    def score(
        self, images: Collection[Float[np.ndarray, "h w 3"]], background: float = 1.0
    ) -> Float[np.ndarray, " b"]:
        """SD score of images at `TIMESTEPS` with `SEEDS`.

        Args:
            images: Images with values in [0, 1].
            background: Grey value of the padding.

        Returns:
            Score of each image; it does not depend on the other images.
        """
        import torch

        latents = torch.stack([self.encode(image, background) for image in images])
        return sd_score(self.predict_noise, latents, TIMESTEPS, SEEDS, self.alphas_cumprod)


def load_stable_diffusion(folder: Path, device: str = "cpu") -> StableDiffusion:
    """Load a Stable Diffusion model in float32.

    Args:
        folder: Model in the layout of diffusers: `NETWORK_FILES` are read.
        device: PyTorch's name of the device to compute on.

    Returns:
        The model.

    Raises:
        InputError: A file is missing or cannot be read, parameters are missing, or the scheduler is of another kind.
    """
    for part, names in NETWORK_FILES.items():
        for name in names:
            if not (folder / part / name).is_file():
                raise InputError(f"no such file: {part}/{name}", file=folder)
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # read when the hub's client is imported
    import torch
    from diffusers import AutoencoderKL, DDPMScheduler, UNet2DConditionModel
    from transformers import CLIPTextModel, CLIPTokenizer

    unet = _load(UNet2DConditionModel, folder, "unet", low_cpu_mem_usage=False)
    vae = _load(AutoencoderKL, folder, "vae", low_cpu_mem_usage=False)
    text_encoder = _load(CLIPTextModel, folder, "text_encoder")
    try:
        scheduler = DDPMScheduler.from_pretrained(folder, subfolder="scheduler", local_files_only=True)
        tokenizer = CLIPTokenizer.from_pretrained(folder / "tokenizer", local_files_only=True)
        tokens = tokenizer("", padding="max_length", max_length=tokenizer.model_max_length, return_tensors="pt")
        with torch.inference_mode():
            prompt = text_encoder(tokens.input_ids)[0]
    except Exception as error:  # a damaged file can fail anywhere
        raise _unreadable(folder, error) from error
    kind = scheduler.config.prediction_type
    if kind not in ("epsilon", "v_prediction"):
        problem = f"{kind}; epsilon and v_prediction are known"
        raise InputError(problem, file=folder / "scheduler/scheduler_config.json", field="prediction_type")
    alphas_cumprod = scheduler.alphas_cumprod.double().numpy()
    return StableDiffusion(vae.to(device), unet.to(device), prompt.to(device), alphas_cumprod, kind)


def _load(network: Any, folder: Path, part: str, **options: Any) -> torch.nn.Module:
    try:
        model, report = network.from_pretrained(
            folder / part, local_files_only=True, use_safetensors=True, output_loading_info=True, **options
        )
    except Exception as error:  # a damaged file can fail anywhere
        raise _unreadable(folder / part, error) from error
    missing = [*report["missing_keys"], *report["mismatched_keys"]]
    if missing:  # the libraries fill these with random numbers
        raise InputError(f"{len(missing)} parameters are missing, such as {sorted(map(str, missing))[0]}",
                         file=folder / part)  # fmt: skip
    return model.float().eval()


def _unreadable(file: Path, error: Exception) -> InputError:
    problem = " ".join(str(error).split())[:120]
    return InputError(f"not a readable part of Stable Diffusion ({type(error).__name__}: {problem})", file=file)
