"""Images in the style of one image: image-to-image by Stable Diffusion with an IP-Adapter (Ye et al. 2023)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from jaxtyping import Float32

from carigs.capture.images import read_rgb
from carigs.editing.square_images import from_square, to_square
from carigs.errors import InputError, WeightsMissing
from carigs.readers.weights import read_weights
from carigs.weights.diffusers_parts import load_network, unreadable
from carigs.weights.offline import work_offline
from carigs.weights.registry import registered
from carigs.weights.search import find_weights

if TYPE_CHECKING:
    import torch

BASE, ADAPTER = "stable_diffusion_1.5", "ip_adapter_sd15"
PROMPT = "a caricature portrait"
GUIDANCE, STEPS = 7.5, 30
"""Scale of the guidance by prompt and exemplar together, and steps of the whole schedule."""
SEED = 0
"""All frames get the same noise, so that views differ by what they show alone."""
CLIP_MEAN, CLIP_DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Of the images that the encoder was trained on."""


class ExemplarPainter:
    """Paints images in the style of an exemplar.

    Args:
        pipeline: Diffusers' image-to-image pipeline with a loaded IP-Adapter.
        embeddings: Embedding of the exemplar after that of no image (2, 1, d).
        strength: Share of the schedule that is added as noise and removed again.
        background: Grey value that pads images to squares.
    """

    def __init__(self, pipeline: Any, embeddings: torch.Tensor, strength: float, background: float) -> None:
        self.pipeline, self.embeddings, self.strength, self.background = pipeline, embeddings, strength, background
        self.size = pipeline.unet.config.sample_size * pipeline.vae_scale_factor

    def __call__(self, image: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
        """Paint an image.

        Args:
            image: RGB in [0, 1].

        Returns:
            The painted image, of the same size; always the same for the same image.
        """
        import torch

        square = torch.from_numpy(to_square(image, self.size, self.background)).permute(2, 0, 1)[None]
        steps = max(STEPS, int(np.ceil(1 / self.strength)))  # one step at least
        with torch.inference_mode():
            painted = self.pipeline(
                prompt=PROMPT, image=square, strength=self.strength, num_inference_steps=steps,
                guidance_scale=GUIDANCE, generator=torch.Generator().manual_seed(SEED),
                ip_adapter_image_embeds=[self.embeddings], output_type="np",
            ).images[0]  # fmt: skip
        return from_square(np.asarray(painted, np.float32), image.shape[:2])


def load_exemplar_painter(exemplar: Path, strength: float, background: float) -> ExemplarPainter:
    """Load the networks, and embed the exemplar.

    Args:
        exemplar: Image file.
        strength: As of `ExemplarPainter`.
        background: Grey value that pads images to squares.

    Returns:
        The painter.

    Raises:
        WeightsMissing: Weights or diffusers are missing.
        InputError: The exemplar cannot be read, or a file of the networks is not valid.
    """
    style = read_rgb(exemplar, background)
    base, adapter = registered(BASE), registered(ADAPTER)
    folder, adapter_folder = find_weights(base, None), find_weights(adapter, None)
    work_offline()
    import torch

    try:
        from diffusers import AutoencoderKL, DDIMScheduler, StableDiffusionImg2ImgPipeline, UNet2DConditionModel
        from transformers import CLIPTextModel, CLIPTokenizer, CLIPVisionModelWithProjection
    except ImportError as error:
        raise WeightsMissing(f"{error.name} is not installed: pip install 'carigs[diffusion]'") from error

    encoder_folder = adapter_folder / "models/image_encoder"
    encoder = load_network(CLIPVisionModelWithProjection, encoder_folder, adapter.title)
    text_encoder = load_network(CLIPTextModel, folder / "text_encoder", base.title)
    tokens = text_encoder.config.max_position_embeddings
    try:
        pipeline = StableDiffusionImg2ImgPipeline(
            vae=load_network(AutoencoderKL, folder / "vae", base.title, low_cpu_mem_usage=False),
            text_encoder=text_encoder,
            tokenizer=CLIPTokenizer.from_pretrained(
                folder / "tokenizer", local_files_only=True, model_max_length=tokens
            ),
            unet=load_network(UNet2DConditionModel, folder / "unet", base.title, low_cpu_mem_usage=False),
            # As the configuration of Stable Diffusion says; files of other schedulers may lack it.
            scheduler=DDIMScheduler.from_pretrained(
                folder / "scheduler", local_files_only=True, steps_offset=1, clip_sample=False
            ),
            safety_checker=None, feature_extractor=None, image_encoder=encoder, requires_safety_checker=False,
        )  # fmt: skip
    except InputError:
        raise
    except Exception as error:  # a damaged file can fail anywhere
        raise unreadable(folder, base.title, error) from error
    file = adapter_folder / adapter.files[0].name
    try:
        pipeline.load_ip_adapter(_nested(read_weights(file)), "", "", image_encoder_folder=None)
    except InputError:
        raise
    except Exception as error:  # shapes and names of another network
        raise unreadable(file, adapter.title, error) from error
    pipeline.set_progress_bar_config(disable=True)
    pipeline.to("cuda" if torch.cuda.is_available() else "cpu")
    pixels = _encoder_input(style, encoder.config.image_size, background).to(pipeline.device)
    with torch.inference_mode():
        embedded = encoder(pixels).image_embeds
    embeddings = torch.stack([torch.zeros_like(embedded), embedded])
    return ExemplarPainter(pipeline, embeddings, strength, background)


def _encoder_input(image: Float32[np.ndarray, "h w 3"], size: int, background: float) -> torch.Tensor:
    import torch

    square = to_square(image, max(image.shape[:2]), background)
    small = cv2.resize(square, (size, size), interpolation=cv2.INTER_AREA)
    scaled = (small - np.float32(CLIP_MEAN)) / np.float32(CLIP_DEVIATION)
    return torch.from_numpy(np.ascontiguousarray(scaled.transpose(2, 0, 1)))[None]


def _nested(state: dict[str, torch.Tensor]) -> dict[str, dict[str, torch.Tensor]]:
    """Parameters by the part that their names begin with: `image_proj` and `ip_adapter`."""
    parts: dict[str, dict[str, torch.Tensor]] = {}
    for name, value in state.items():
        part, _, rest = name.partition(".")
        parts.setdefault(part, {})[rest] = value
    return parts
