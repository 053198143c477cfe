"""Edits of a copied capture: entries of frames, pixels and arrays."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stress.capture_changes.folder import SPLITS, Folder

BOTH = ("images", "fg_masks")
"""Folders of images and of mattes."""


def edit_transforms(folder: Folder, change: Callable[[list[dict[str, Any]]], list[dict[str, Any]]]) -> None:
    """Change the lists of frames.

    Args:
        folder: The capture.
        change: Called with the entries of the frames of each split; returns the new ones.
    """
    for split in SPLITS:
        file = folder.root / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        content["frames"] = change(content["frames"])
        file.write_text(json.dumps(content))


def edit_frames(folder: Folder, change: Callable[[dict[str, Any]], object], *, where: str = ".*") -> None:
    """Change entries of frames.

    Args:
        folder: The capture.
        change: Called with each entry.
        where: Regular expression for the names of images.
    """

    def change_all(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        for entry in entries:
            if re.search(where, entry["file_path"]):
                change(entry)
        return entries

    edit_transforms(folder, change_all)


def update_frames(folder: Folder, where: str = ".*", **values: Any) -> None:
    """Set or compute fields of the entries of frames.

    Args:
        folder: The capture.
        where: Regular expression for the names of images.
        **values: By field the new value, or a function of the old one.
    """

    def change(entry: dict[str, Any]) -> None:
        entry.update({key: value(entry[key]) if callable(value) else value for key, value in values.items()})

    edit_frames(folder, change, where=where)


def edit_images(
    folder: Folder, change: Callable[[np.ndarray], np.ndarray], where: str = ".*", kinds: tuple[str, ...] = ("images",)
) -> None:
    """Change pixels.

    Args:
        folder: The capture.
        change: From the pixels of a file, 0 to 255, to the new ones.
        where: Regular expression for the names of images.
        kinds: Which of `BOTH`.
    """
    for kind in kinds:
        for file in sorted((folder.root / kind).iterdir()):
            if re.search(where, file.name):
                pixels = change(cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.float64))
                file.unlink()
                cv2.imwrite(str(file), np.rint(np.clip(pixels, 0, 255)).astype(np.uint8))


def composite(folder: Folder, background: float, foreground: float = 1.0) -> None:
    """Put the foreground, which is on white, on another background.

    Args:
        folder: The capture.
        background: Brightness of the new background in [0, 1].
        foreground: Factor of the brightness of the foreground.
    """
    for file in sorted((folder.root / "images").iterdir()):
        matte = cv2.imread(str(folder.root / "fg_masks" / file.name), cv2.IMREAD_GRAYSCALE)[..., None] / 255
        edit_images(
            folder,
            lambda image, a=matte: foreground * (image - 255 * (1 - a)) + 255 * background * (1 - a),
            f"^{re.escape(file.name)}$",
        )


def edit_arrays(file: Path, change: Callable[[dict[str, np.ndarray]], object]) -> None:
    """Change the arrays of an npz file.

    Args:
        file: The file. A link is replaced.
        change: Called with all arrays by name.
    """
    with np.load(file, allow_pickle=False) as content:
        arrays = dict(content)
    change(arrays)
    file.unlink()
    np.savez(file, **arrays)


def edit_parameters(folder: Folder, where: str = ".*", **values: Callable[[np.ndarray], Any]) -> None:
    """Change head parameters.

    Args:
        folder: The capture.
        where: Regular expression for the names of the timesteps' files.
        **values: By array a function from the old to the new one.
    """
    for file in sorted((folder.root / "flame_param").iterdir()):
        if re.search(where, file.name):
            edit_arrays(file, lambda arrays: arrays.update({k: np.asarray(v(arrays[k])) for k, v in values.items()}))
