"""Where PyTorch evaluates networks."""

from __future__ import annotations


def set_up_torch(threads: int) -> str:
    """Set the number of PyTorch's threads, and choose the device; CUDA_VISIBLE_DEVICES can hide GPUs.

    Args:
        threads: Threads of the CPU.

    Returns:
        `cuda` if PyTorch finds a GPU, else `cpu`.
    """
    import torch

    torch.set_num_threads(threads)
    return "cuda" if torch.cuda.is_available() else "cpu"
