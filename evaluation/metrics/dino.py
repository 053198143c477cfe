"""DINO similarity between rendered and original frames (Caron et al. 2021): the score and the network, ViT-B/8."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from evaluation.metrics.weights import load_state

if TYPE_CHECKING:
    import torch

MODEL = "vit_base_patch8_224.dino"


def dino_similarity(rendered: Float[np.ndarray, "n d"], original: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """DINO score of table 1: cosine similarity of the class tokens of rendered and original frames.

        DINO = E(render) . E(original),  |E| = 1

    Identity preservation by DINO features (Caron et al. 2021), following Zhou et al. 2024 (DoesFS). The unedited frame
    itself has score 1, so read the score together with the level.

    Args:
        rendered: Normalised embeddings of rendered frames.
        original: Normalised embeddings of the same frames of the capture.

    Returns:
        Cosine similarity of each pair.
    """
    return (rendered * original).sum(axis=1)


def load_dino(file: Path, model: str = MODEL) -> torch.nn.Module:
    """Load a DINO network, whose output is the class token after the final norm.

    Args:
        file: Network weights.
        model: Name of the architecture in timm.

    Returns:
        The network, in evaluation mode.

    Raises:
        InputError: The weights do not fit the architecture.
    """
    import timm

    return load_state(timm.create_model(model, pretrained=False, num_classes=0), file, f"DINO {model}")
