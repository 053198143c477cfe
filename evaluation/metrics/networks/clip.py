"""CLIP-I, CLIP-D and CLIP-C of table 1 as functions of normalised embeddings, and the CLIP network (OpenAI ViT-B/32).

E is the embedding of a rendered frame, O of the same frame without the edit, T of a prompt; all have length 1.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.weights.registry import registered
from evaluation.metrics.networks.parameters import load_state

if TYPE_CHECKING:
    import torch

WEIGHTS = "clip_vit_b32_openai"
"""Entry of the registry of weights."""
STATISTICS = ((0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711))
"""Mean and standard deviation of the channels of its input."""
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


def clip_i_image(images: Float[np.ndarray, "n d"], originals: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Similarity of images, which other papers call CLIP-I (Ruiz et al. 2023, DreamBooth).

        CLIP-I = E . O

    Args:
        images: Embeddings E of rendered frames.
        originals: Embeddings O of the same frames of the capture.

    Returns:
        Cosine of each pair; 1 for an avatar that does nothing.
    """
    return (images * originals).sum(axis=1)


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
    return _direction_cosine(edited - original, text_edited - text_original)


def clip_c_adjacent(images: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n-1"]:
    """CLIP-C of table 1, consistency: cosine between adjacent views of a novel trajectory.

        CLIP-C_i = E_i . E_(i+1)

    The paper's wording. Its source, Haque et al. 2023 (Instruct-NeRF2NeRF), has no code of its consistency, and its
    text fits `clip_c_dir_edit` and `clip_c_dir_motion` as well. Neighbouring values share a frame: intervals that take
    them as independent are somewhat too narrow.

    Args:
        images: Embeddings of the frames in the order of the trajectory.

    Returns:
        Cosine of each frame and its next.
    """
    return (images[:-1] * images[1:]).sum(axis=1)


def clip_c_dir_edit(edited: Float[np.ndarray, "n d"], original: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n-1"]:
    """CLIP-C as consistency of the edit: adjacent frames are changed in the same direction.

        CLIP-C_i = cos(E_i - O_i, E_(i+1) - O_(i+1))

    Args:
        edited: Embeddings E of the frames in the order of the trajectory.
        original: Embeddings O of the same frames without the edit.

    Returns:
        Cosine of each frame and its next; 0 where the edit changes nothing.
    """
    change = edited - original
    return _direction_cosine(change[:-1], change[1:])


def clip_c_dir_motion(
    edited: Float[np.ndarray, "n d"], original: Float[np.ndarray, "n d"]
) -> Float[np.ndarray, " n-1"]:
    """CLIP-C as consistency of the motion: from frame to frame the edited video changes as the original one.

        CLIP-C_i = cos(E_(i+1) - E_i, O_(i+1) - O_i)

    Args:
        edited: Embeddings E of the frames in the order of the trajectory.
        original: Embeddings O of the same frames without the edit.

    Returns:
        Cosine of each frame and its next; 0 where nothing moves.
    """
    return _direction_cosine(np.diff(edited, axis=0), np.diff(original, axis=0))


def _direction_cosine(a: Float[np.ndarray, "n d"], b: Float[np.ndarray, "*broadcast d"]) -> Float[np.ndarray, " n"]:
    """Cosine of differences of embeddings; 0 where there is none."""
    length = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return np.where(length > 1e-9, (a * b).sum(axis=-1) / np.maximum(length, 1e-9), 0.0)


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
        trusted = [known.sha256 for known in registered(WEIGHTS).files]
    return load_state(model, file, f"CLIP {MODEL}", trusted)


def embed_texts(model: torch.nn.Module, prompts: Sequence[str]) -> Float[np.ndarray, "n d"]:
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
        tokens = open_clip.get_tokenizer(MODEL)(list(prompts))
        return model.encode_text(tokens, normalize=True).double().numpy()
