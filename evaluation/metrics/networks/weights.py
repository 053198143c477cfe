"""Network weights: the registry `weights.toml`, and the search for its files. Imports no network library."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from carigs.errors import InputError, WeightsMissing
from carigs.readers.folders import listed
from carigs.readers.weights import read_weights
from carigs.system.cache_folders import user_cache
from evaluation.metrics.networks.checksums import check_file
from evaluation.metrics.networks.downloads import Download, download_files

if TYPE_CHECKING:
    import torch

REGISTRY = Path(__file__).with_name("weights.toml")
FOLDER_VARIABLE = "CARIGS_WEIGHTS"
"""Environment variable that names a folder with weights."""
_NO_PARAMETERS = ("input_resolution", "context_length", "vocab_size")  # numbers that OpenAI stores among the weights


@dataclass(frozen=True)
class WeightsFile:
    """One file of an entry of the registry; see `weights.toml` for the fields."""

    name: str
    hub: str
    url: str
    bytes: int | None
    sha256: str


@dataclass(frozen=True)
class Weights:
    """Entry of the registry; see `weights.toml` for the fields."""

    name: str
    title: str
    licence: str
    files: tuple[WeightsFile, ...]
    hub: str = ""
    folder: str = ""

    @property
    def wanted(self) -> tuple[WeightsFile, ...]:
        """What is downloaded: all files of a folder, else the first."""
        return self.files if self.folder else self.files[:1]

    @property
    def size(self) -> int | None:
        """Bytes of what is downloaded; None if unknown."""
        sizes = [file.bytes for file in self.wanted]
        return None if None in sizes else sum(sizes)


class FoundWeights(NamedTuple):
    """Weights on this machine."""

    path: Path
    """The file, or the folder of all files."""
    files: dict[WeightsFile, Path]


def registry() -> dict[str, Weights]:
    """Read the registry.

    Returns:
        All entries by name, in its order.
    """
    return {name: _entry(name, **table) for name, table in tomllib.loads(REGISTRY.read_text(encoding="utf-8")).items()}


def registered(name: str) -> Weights:
    """Look up an entry of the registry.

    Args:
        name: Its name.

    Returns:
        The entry.
    """
    return registry()[name]


def _entry(name: str, files: list[dict], hub: str = "", **fields: str) -> Weights:
    def complete(name: str, **file) -> WeightsFile:
        in_hub = file.pop("hub", "" if "url" in file or not hub else name)
        url = file.pop("url", f"https://huggingface.co/{hub}/resolve/main/{in_hub}")
        return WeightsFile(name, in_hub, url, file.pop("bytes", None), file.pop("sha256", ""), **file)

    return Weights(name, files=tuple(complete(**file) for file in files), hub=hub, **fields)


def find_weights(weights: Weights, folder: str | Path | None, *, download: bool = False) -> Path:
    """Find weights and verify their size and checksum where these are known.

    Searches `folder`, the folder that the environment variable CARIGS_WEIGHTS names, the cache of the Hugging Face hub,
    and that of torch hub. Nothing is asked over the network unless `download` is set.

    Args:
        weights: Entry of the registry.
        folder: Folder to search first; None for the other places alone.
        download: Whether to download what is missing, into the first of the two folders that is set, else into torch
            hub's cache.

    Returns:
        The file, or the folder of a network of several files.

    Raises:
        WeightsMissing: They are nowhere, or the download failed; names files, places and source.
        InputError: A file has another size or checksum than the registry states.
    """
    found = locate_weights(weights, folder)
    if found is None:
        missing = _missing(weights, folder)
        if not download:
            raise WeightsMissing(missing)
        try:
            places = [*_folders(folder), *_torch_cache()]
            if not places:
                raise WeightsMissing(f"no folder for {weights.name}: name one with --folder or {FOLDER_VARIABLE}")
            return _download(weights, places[0] / weights.folder)
        except InputError as error:
            raise WeightsMissing(f"{missing}; the download failed: {error.problem}") from error
    for file, path in found.files.items():
        verify(weights, file, path)
    return found.path


def locate_weights(weights: Weights, folder: str | Path | None) -> FoundWeights | None:
    """Search weights in the places of `find_weights`; nothing is read.

    Args:
        weights: Entry of the registry.
        folder: Folder to search first, or None.

    Returns:
        The first place that has them; None if there is none.
    """
    for candidate in _candidates(weights, folder):
        if all(map(os.path.isfile, candidate.files.values())):  # False also where a folder cannot be entered
            return candidate
    return None


def verify(weights: Weights, file: WeightsFile, path: Path) -> str:
    """Compare a file with the registry, or with the checksum that was kept when it was downloaded.

    Args:
        weights: Entry of the registry.
        file: Its file.
        path: Where it is.

    Returns:
        What was compared: see `check_file`.

    Raises:
        InputError: Size or checksum differ.
    """
    remedy = f"remove it and get it again by `carigs weights fetch {weights.name}`"
    return check_file(path, weights.title, size=file.bytes, sha256=file.sha256, remedy=remedy)


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


def work_offline() -> None:
    """Tell the client of the Hugging Face hub to ask nothing over the network, which it otherwise waits for.

    It reads this when it is imported: call this before a network library is. Weights are found or downloaded here,
    never by those libraries.
    """
    os.environ.setdefault("HF_HUB_OFFLINE", "1")


def _missing(weights: Weights, folder: str | Path | None) -> str:
    """Say which files are missing, where they are expected, and how to get them."""
    names = f"folder {weights.folder}" if weights.folder else " or ".join(file.name for file in weights.files)
    searched = ", ".join(map(str, [*_folders(folder), *_hub_cache(), *_torch_cache()])) or "any folder"
    return (
        f"no {weights.name} weights ({names}) in {searched}; get them by `carigs weights fetch {weights.name}` or from "
        f"{weights.wanted[0].url}, licence {weights.licence}"
    )


def _download(weights: Weights, root: Path) -> Path:
    paths = {file: root / file.name for file in weights.wanted}
    download_files(Download(file.url, path, weights.title, file.bytes, file.sha256) for file, path in paths.items())
    return root if weights.folder else next(iter(paths.values()))


def _candidates(weights: Weights, folder: str | Path | None) -> Iterator[FoundWeights]:
    """Where weights can be, in the order of the search."""

    def of(root: Path, names: dict[WeightsFile, str]) -> Iterator[FoundWeights]:
        paths = {file: root / name for file, name in names.items()}
        if weights.folder:
            yield FoundWeights(root, paths)
        else:
            yield from (FoundWeights(path, {file: path}) for file, path in paths.items())

    plain = {file: file.name for file in weights.files}
    for place in _folders(folder):
        yield from of(place / weights.folder, plain)
    for cache in _hub_cache() if weights.hub else []:
        snapshots = cache / f"models--{weights.hub.replace('/', '--')}" / "snapshots"
        for snapshot in listed(snapshots):
            yield from of(snapshot, {file: file.hub for file in weights.files if file.hub})
    for cache in _torch_cache():
        yield from of(cache / weights.folder, plain)


def _folders(folder: str | Path | None) -> list[Path]:
    """Folders that the user names: in the settings, and in the environment."""
    return [_expanded(place) for place in (folder, os.environ.get(FOLDER_VARIABLE)) if place]


def _hub_cache() -> list[Path]:
    """The folder in which clients of the Hugging Face hub keep what they download; none for a user without a home."""
    if chosen := os.environ.get("HF_HUB_CACHE"):
        return [_expanded(chosen)]
    return [home / "hub" for home in _named_or_in_cache("HF_HOME", "huggingface")]


def _torch_cache() -> list[Path]:
    """The folder in which PyTorch keeps weights; none for a user without a home folder."""
    return [home / "hub" / "checkpoints" for home in _named_or_in_cache("TORCH_HOME", "torch")]


def _named_or_in_cache(variable: str, name: str) -> list[Path]:
    if chosen := os.environ.get(variable):
        return [_expanded(chosen)]
    cache = user_cache()
    return [cache / name] if cache else []


def _expanded(path: str | Path) -> Path:
    """The path with the home folder for `~`, as the shell has it: unchanged for a user without one."""
    return Path(os.path.expanduser(path))
