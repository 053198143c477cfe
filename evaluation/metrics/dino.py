"""DINO similarity: the cosine of class tokens, and the network (ViT-B/8) that makes those."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from evaluation.metrics.weights import read_state

if TYPE_CHECKING:
    import torch

MODEL = "vit_base_patch8_224.dino"


def paired_cosine(a: Float[np.ndarray, "n d"], b: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n"]:
    """Cosine of each pair of normalised embeddings."""
    return (a * b).sum(axis=1)


def load_dino(file: Path, model: str = MODEL) -> torch.nn.Module:
    """Timm's `model` with the parameters in `file`; its output is the final-norm class token.

    Raises `InputError` if the parameters do not fit.
    """
    import timm

    network = timm.create_model(model, pretrained=False, num_classes=0)
    try:
        network.load_state_dict(read_state(file))
    except RuntimeError as error:
        problem = " ".join(str(error).split())[:120]
        raise InputError(f"these weights are not DINO {model} ({problem})", file=file) from error
    return network.eval()
