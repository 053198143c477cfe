"""Parameters of networks from files of weights, without the network."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.errors import InputError
from carigs.readers.weights import read_weights

if TYPE_CHECKING:
    import torch

_NO_PARAMETERS = ("input_resolution", "context_length", "vocab_size")  # numbers that OpenAI stores among the weights


def load_state(network: torch.nn.Module, file: Path, name: str, trusted: Collection[str] = ()) -> torch.nn.Module:
    """Load a network's parameters from a file.

    Args:
        network: Network to load into.
        file: File of any format that `read_weights` knows.
        name: Name of the network, for the error message.
        trusted: SHA-256 of TorchScript archives that may be loaded.

    Returns:
        The network, in evaluation mode.

    Raises:
        InputError: The file cannot be read, or the parameters do not fit the network.
    """
    state = {name: value for name, value in read_weights(file, trusted).items() if name not in _NO_PARAMETERS}
    try:
        network.load_state_dict(state)
    except RuntimeError as error:
        problem = " ".join(str(error).split())[:120]
        raise InputError(f"these weights are not {name} ({problem})", file=file) from error
    return network.eval()
