"""Packages that only some commands need, and the extras of carigs that bring them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from carigs.errors import PackageMissing

EXTRAS = {
    "PIL": "avatar",
    "ai_edge_litert": "video",
    "diffusers": "diffusion",
    "flatbuffers": "video",
    "jinja2": "avatar",
    "matplotlib": "study",
    "open_clip": "study",
    "pandas": "study",
    "snakemake": "study",
    "timm": "study",
    "torch": "avatar",
    "torchmetrics": "study",
    "torchvision": "study",
    "transformers": "diffusion",
    "viser": "viewer",
}
"""Extras by the name that modules import."""


def need(package: str) -> None:
    """Check that a package is installed, before any work that needs it later.

    Args:
        package: Name of `EXTRAS`.

    Raises:
        PackageMissing: If it is not installed.
    """
    if find_spec(package) is None:
        raise _missing(package)


@contextmanager
def naming_extras() -> Iterator[None]:
    """Name the extra that brings a package which the block imports, and which is not installed.

    Yields:
        Nothing.

    Raises:
        PackageMissing: If a package of `EXTRAS` is not installed.
        ModuleNotFoundError: If any other module is missing: that is a mistake of the program.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS:
            raise
        raise _missing(package) from error


def _missing(package: str) -> PackageMissing:
    return PackageMissing(f"{package} is not installed: pip install 'carigs[{EXTRAS[package]}]'")
