"""CLIP-I, CLIP-D and CLIP-C of table 1 as functions of normalised embeddings, and the CLIP network (OpenAI ViT-B/32).

E is the embedding of a rendered frame, O of the same frame of the capture, T of a prompt; all have length 1.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from evaluation.metrics.weights import load_state, registered

if TYPE_CHECKING:
    import torch

WEIGHTS = "clip_vit_b32_openai"
"""Entry of the registry of weights."""
MODEL = "ViT-B-32-quickgelu"  # OpenAI's weights give wrong features in "ViT-B-32", without any warning


def clip_i(images: Float[np.ndarray, "n d"], text: Float[np.ndarray, " d"]) -> Float[np.ndarray, " n"]:
    """CLIP-I of table 1, image-prompt similarity: cosine between each image and the edit prompt.

        CLIP-I = E . T_edit

    This is the paper's definition in words. Its values (0.67 to 0.73) fit `clip_i_score` better.

    Args:
        images: Embeddings of rendered frames.
        text: Embedding of the edit prompt.

    Returns:
        Cosine of each frame.
    """
    return images @ text


def clip_i_score(
    images: Float[np.ndarray, "n d"], text: Float[np.ndarray, " d"], weight: float = 2.5
) -> Float[np.ndarray, " n"]:
    """CLIP-I of table 1 as CLIPScore (Hessel et al. 2021), the reference that the paper cites for it.

        CLIP-S = 2.5 max(E . T_edit, 0)

    Args:
        images: Embeddings of rendered frames.
        text: Embedding of the edit prompt.
        weight: Factor; 2.5 in Hessel et al. 2021.

    Returns:
        Score of each frame.
    """
    return weight * np.maximum(images @ text, 0)


def clip_d(
    edited: Float[np.ndarray, "n d"],
    original: Float[np.ndarray, "n d"],
    text_edited: Float[np.ndarray, " d"],
    text_original: Float[np.ndarray, " d"],
) -> Float[np.ndarray, " n"]:
    """CLIP-D of table 1, directional similarity (Gal et al. 2021, StyleGAN-NADA).

        CLIP-D = cos(E - O, T_edit - T_source)

    Args:
        edited: Embeddings E of rendered frames.
        original: Embeddings O of the same frames of the capture.
        text_edited: Embedding of the edit prompt.
        text_original: Embedding of the source prompt.

    Returns:
        Cosine of each frame; 0 if the render equals the frame.
    """
    change, text_change = edited - original, text_edited - text_original
    length = np.linalg.norm(change, axis=-1) * np.linalg.norm(text_change)
    return np.where(length > 1e-9, (change @ text_change) / np.maximum(length, 1e-9), 0.0)


def clip_c(images: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n-1"]:
    """CLIP-C of table 1, consistency: cosine between adjacent views of a novel trajectory.

        CLIP-C_i = E_i . E_(i+1)

    The paper's wording, which follows Haque et al. 2023 (Instruct-NeRF2NeRF). Neighbouring values share a frame:
    intervals that take them as independent are somewhat too narrow.

    Args:
        images: Embeddings of the frames of the orbit, in its order.

    Returns:
        Cosine of each frame and its next.
    """
    return (images[:-1] * images[1:]).sum(axis=1)


def load_clip(
    file: Path, config: Mapping[str, Any] | None = None, trusted: Collection[str] | None = None
) -> torch.nn.Module:
    """Load a CLIP network.

    Args:
        file: Network weights.
        config: Architecture in open_clip's format; OpenAI's ViT-B/32 by default.
        trusted: SHA-256 of TorchScript archives that may be loaded; by default that of OpenAI's.

    Returns:
        The network, in evaluation mode.

    Raises:
        InputError: The weights do not fit the architecture, or its activation is not QuickGELU, as OpenAI trained it.
    """
    import open_clip

    config = dict(open_clip.get_model_config(MODEL) if config is None else config)
    model = open_clip.CLIP(**config)
    blocks = [*model.visual.transformer.resblocks, *model.transformer.resblocks]
    if any(type(block.mlp.gelu).__name__ != "QuickGELU" for block in blocks):
        raise InputError("these weights need QuickGELU, the network has another activation", file=file)
    if trusted is None:
        trusted = registered(WEIGHTS).sha256.values()
    return load_state(model, file, f"CLIP {MODEL}", trusted)


def embed_texts(model: torch.nn.Module, prompts: list[str]) -> Float[np.ndarray, "n d"]:
    """Embed prompts.

    Args:
        model: CLIP network.
        prompts: Texts.

    Returns:
        Normalised float64 embeddings.
    """
    import open_clip
    import torch

    with torch.inference_mode():
        tokens = open_clip.get_tokenizer(MODEL)(prompts)
        return model.encode_text(tokens, normalize=True).double().numpy()
