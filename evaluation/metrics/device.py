"""Where networks are evaluated."""

from __future__ import annotations


def torch_device() -> str:
    """Choose the device; CUDA_VISIBLE_DEVICES can hide GPUs.

    Returns:
        `cuda` if PyTorch finds a GPU, else `cpu`.
    """
    import torch

    return "cuda" if torch.cuda.is_available() else "cpu"
