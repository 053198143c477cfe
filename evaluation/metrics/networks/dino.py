"""DINO similarity between rendered and original frames (Caron et al. 2021): the score and the networks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from evaluation.metrics.networks.parameters import load_state

if TYPE_CHECKING:
    import torch

MODELS = {"dino_vits16": "vit_small_patch16_224.dino", "dino_vitb8": "vit_base_patch8_224.dino"}
"""Architecture in timm by the entry of the registry of weights."""
STATISTICS = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Mean and standard deviation of the channels of the input (ImageNet's)."""


def dino_similarity(rendered: Float[np.ndarray, "n d"], original: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """DINO score of table 1: cosine similarity of the features of rendered and original frames.

        DINO = E(render) . E(original),  |E| = 1

    Identity preservation by DINO features (Caron et al. 2021), following Zhou et al. 2024 (DoesFS). The unedited frame
    itself has score 1, so read the score together with the level. Of features of patches (`class_and_patch_tokens`) it
    is the mean cosine over the patches.

    Args:
        rendered: Normalised embeddings of rendered frames.
        original: Normalised embeddings of the same frames of the capture.

    Returns:
        Cosine similarity of each pair.
    """
    return (rendered * original).sum(axis=1)


def load_dino(file: Path, model: str) -> torch.nn.Module:
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


def class_and_patch_tokens(
    network: torch.nn.Module, images: Float[torch.Tensor, "n 3 s s"]
) -> tuple[Float[torch.Tensor, "n d"], Float[torch.Tensor, "n pd"]]:
    """Features of both kinds by one pass.

    Args:
        network: Network of `load_dino`.
        images: Preprocessed images.

    Returns:
        The class token after the final norm; and the output of the last block (layer 11, counted from 0) for all
        patches, in float16, each of length 1 and one after the other. So the cosine of two images is the mean cosine
        of their patches (the feature of DoesFS's loss).
    """
    last = len(network.blocks) - 1
    final, (patches,) = network.forward_intermediates(images, indices=[last], norm=False, output_fmt="NLC")
    patches = patches / patches.norm(dim=2, keepdim=True)
    return network.forward_head(final), patches.flatten(1).half()
