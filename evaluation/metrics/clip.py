"""CLIP scores: pure functions of normalised embeddings, and the network (OpenAI ViT-B/32) that makes those."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from evaluation.metrics.weights import read_state

if TYPE_CHECKING:
    import torch

MODEL = "ViT-B-32-quickgelu"  # OpenAI's weights in plain "ViT-B-32" give wrong features, without any warning


def text_cosine(images: Float[np.ndarray, "n d"], text: Float[np.ndarray, "d"]) -> Float[np.ndarray, "n"]:
    """CLIP-I as the paper words it: the cosine between each image and the prompt."""
    return images @ text


def clip_score(
    images: Float[np.ndarray, "n d"], text: Float[np.ndarray, "d"], weight: float = 2.5
) -> Float[np.ndarray, "n"]:
    """CLIPScore (Hessel et al. 2021): weight x max(cosine, 0); its scale fits the paper's CLIP-I."""
    return weight * np.maximum(images @ text, 0)


def directional(
    edited: Float[np.ndarray, "n d"],
    original: Float[np.ndarray, "n d"],
    text_edited: Float[np.ndarray, "d"],
    text_original: Float[np.ndarray, "d"],
) -> Float[np.ndarray, "n"]:
    """CLIP-D (Gal et al. 2021): cosine between the change of each image and the change of the prompt.

    0 where nothing changed.
    """
    return _cosine(edited - original, text_edited - text_original)


def adjacent(images: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n-1"]:
    """CLIP-C: the cosine of neighbouring frames, in the given order.

    Neighbouring values share a frame: intervals that take them as independent are somewhat too narrow.
    """
    return (images[:-1] * images[1:]).sum(axis=1)


def load_clip(file: Path, config: Mapping[str, Any] | None = None) -> torch.nn.Module:
    """The network with the parameters in `file`, ready to embed.

    `config` is open_clip's, by default that of OpenAI's ViT-B/32.  Raises `InputError` if the parameters do not fit,
    or if the network's activation is not the QuickGELU that OpenAI trained with.
    """
    import open_clip

    config = dict(open_clip.get_model_config(MODEL) if config is None else config)
    model = open_clip.CLIP(**config)
    blocks = [*model.visual.transformer.resblocks, *model.transformer.resblocks]
    if any(type(block.mlp.gelu).__name__ != "QuickGELU" for block in blocks):
        raise InputError("these weights need QuickGELU, the network has another activation", file=file)
    try:
        model.load_state_dict(read_state(file))
    except RuntimeError as error:
        raise InputError(f"these weights are not CLIP {MODEL} ({_first_line(error)})", file=file) from error
    return model.eval()


def embed_texts(model: torch.nn.Module, prompts: list[str]) -> Float[np.ndarray, "n d"]:
    """Normalised float64 embeddings of the prompts."""
    import open_clip
    import torch

    with torch.inference_mode():
        tokens = open_clip.get_tokenizer(MODEL)(prompts)
        return model.encode_text(tokens, normalize=True).double().numpy()


def _cosine(a: Float[np.ndarray, "n d"], b: Float[np.ndarray, "d"]) -> Float[np.ndarray, "n"]:
    length = np.linalg.norm(a, axis=-1) * np.linalg.norm(b)
    return np.where(length > 1e-9, (a @ b) / np.maximum(length, 1e-9), 0.0)


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]
