"""A copy of a capture, whose files can be replaced."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

SPLITS = ("train", "val", "test")


class Folder(NamedTuple):
    """A copy of a capture."""

    root: Path
    model: Path
    options: dict[str, float]
    """Keywords of `read_dataset`."""


Change = Callable[[Folder], object]


def copy_capture(source: Path, model: Path, folder: Path) -> Folder:
    """Copy a capture; images are links until a case replaces them.

    Args:
        source: The capture.
        model: Its head model.
        folder: Where to copy to.

    Returns:
        The copy.
    """
    for name in ("images", "fg_masks", "flame_param"):
        (folder / name).mkdir(parents=True)
        for file in (source / name).iterdir():
            os.symlink(file.resolve(), folder / name / file.name)
    for split in SPLITS:
        shutil.copyfile(source / f"transforms_{split}.json", folder / f"transforms_{split}.json")
    copied = folder / "head_model.npz"
    os.symlink(model.resolve(), copied)
    return Folder(folder, copied, {})


def swap_files(folder: Folder, a: str, b: str) -> None:
    """Exchange two files.

    Args:
        folder: The capture.
        a: A file, relative to its root.
        b: Another file.
    """
    first, second, between = folder.root / a, folder.root / b, folder.root / "between"
    first.rename(between)
    second.rename(first)
    between.rename(second)
