"""Network weights: the registry `weights.toml`, and the search for its files. Imports no network library."""

from __future__ import annotations

import hashlib
import os
import tomllib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.errors import InputError, WeightsMissing
from carigs.readers.weights import read_weights

if TYPE_CHECKING:
    import torch

REGISTRY = Path(__file__).with_name("weights.toml")
_NO_PARAMETERS = ("input_resolution", "context_length", "vocab_size")  # numbers that OpenAI stores among the weights


@dataclass(frozen=True)
class Weights:
    """Entry of the registry; see `weights.toml` for the fields."""

    name: str
    files: Sequence[str]
    hub: str
    hub_files: Sequence[str]
    source: str
    licence: str
    sha256: dict[str, str]


def registered(name: str) -> Weights:
    """Look up an entry of the registry.

    Args:
        name: Its name.

    Returns:
        The entry.
    """
    return Weights(name, **tomllib.loads(REGISTRY.read_text(encoding="utf-8"))[name])


def find_weights(weights: Weights, folder: str | Path | None, *, download: bool = False) -> Path:
    """Find a weights file and verify its checksum where one is known.

    Searches `folder`, then the caches of the Hugging Face hub and of torch hub.

    Args:
        weights: Entry of the registry.
        folder: Folder to search first; None for the caches alone.
        download: Whether to download a missing file from the hub.

    Returns:
        The file.

    Raises:
        WeightsMissing: There is no such file; names files, folders and source.
        InputError: The checksum differs.
    """
    hub_cache, torch_cache = _caches()
    candidates = [Path(folder) / file for file in weights.files] if folder else []
    snapshots = hub_cache / f"models--{weights.hub.replace('/', '--')}" / "snapshots"
    candidates += [file for name in weights.hub_files for file in sorted(snapshots.glob(f"*/{name}"))]
    candidates += [torch_cache / file for file in weights.files]
    for file in candidates:
        if file.is_file():
            _verify(file, weights)
            return file
    searched = ", ".join(str(place) for place in (folder, hub_cache, torch_cache) if place)
    missing = (
        f"no {weights.name} weights ({' or '.join(weights.files)}) in {searched}; "
        f"get them from {weights.source} or huggingface.co/{weights.hub}, licence {weights.licence}"
    )
    if download:
        return _download(weights, missing)
    raise WeightsMissing(missing)


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


def _verify(file: Path, weights: Weights) -> None:
    expected = weights.sha256.get(file.name)
    if expected is None:
        return
    with file.open("rb") as stream:
        actual = hashlib.file_digest(stream, "sha256").hexdigest()
    if not actual.startswith(expected):
        raise InputError(f"sha256 begins with {actual[:12]}, {weights.name} has {expected[:12]}", file=file)


def _download(weights: Weights, missing: str) -> Path:
    from huggingface_hub import hf_hub_download

    try:
        return Path(hf_hub_download(weights.hub, weights.hub_files[0]))
    except Exception as error:  # the hub's client raises many unrelated types for "no network"
        raise WeightsMissing(f"{missing}; the download failed ({type(error).__name__})") from error


def _caches() -> tuple[Path, Path]:
    """Caches of the Hugging Face hub and of torch hub."""
    user = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    hub = os.environ.get("HF_HUB_CACHE") or Path(os.environ.get("HF_HOME") or user / "huggingface") / "hub"
    torch_hub = Path(os.environ.get("TORCH_HOME") or user / "torch") / "hub" / "checkpoints"
    return Path(hub).expanduser(), torch_hub.expanduser()
