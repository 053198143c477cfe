"""Oddities: captures that are unusual and sound, which must be accepted without a word."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import cv2
import numpy as np

from stress.capture_changes.edits import (
    composite,
    edit_frames,
    edit_images,
    edit_parameters,
    edit_transforms,
    update_frames,
)
from stress.capture_changes.folder import Change, Folder


def oddities() -> Iterator[tuple[str, Change]]:
    """Changes that leave a capture sound.

    Yields:
        Name and change.
    """
    yield "as it is", lambda folder: None
    yield "black background", partial(_own_background, background=0.0)
    yield "grey background", partial(_own_background, background=0.5)
    yield "dark on black", partial(_own_background, background=0.0, foreground=0.25)
    yield "dark on white", partial(_own_background, background=1.0, foreground=0.3)
    yield "bright on black", partial(_own_background, background=0.0, foreground=1.6)
    yield "cropped off the centre", partial(_crop, left=40, top=30, right=15, bottom=60)
    yield "cropped into the face", partial(_crop, left=70, top=100, right=70, bottom=120)
    yield "half the resolution", partial(_resize, factor=0.5)
    yield "an eighth of the resolution", partial(_resize, factor=0.125)
    yield "a camera", partial(_keep_frames, where="_03")
    yield "two cameras", partial(_keep_frames, where="_(08|03)")
    yield "three cameras", partial(_keep_frames, where="_(08|03|12)")
    yield "a timestep of each split", partial(_keep_frames, where="(00003|00028)_")
    yield "one camera, two timesteps", partial(_keep_frames, where="(00003|00028)_03")
    yield "four timesteps", partial(_keep_frames, where="(00003|00010|00016|00028)_")
    yield "other numbers and order", _renumber
    yield "noise of 0.03", partial(edit_images, change=_noise(0.03))
    yield "JPEG of quality 60", partial(_jpeg, quality=60)
    yield "blurred", partial(edit_images, change=lambda image: cv2.GaussianBlur(image, (0, 0), 1.5))
    yield "grey images", partial(edit_images, change=lambda i: np.repeat(i.mean(axis=2, keepdims=True), 3, axis=2))
    yield "flicker of 5 %", partial(edit_images, change=_random_gain(0.05))
    yield "cameras of different colours", partial(_camera_colours, deviation=0.1)
    yield "tracking noise", _tracking_noise
    yield "cut below the neck", partial(_below_line, share=0.8)
    yield "mattes grown by 2 pixels", partial(edit_images, change=_grow(2), kinds=("fg_masks",))
    yield "mattes shrunk by 2 pixels", partial(edit_images, change=_grow(-2), kinds=("fg_masks",))
    yield "hard mattes", partial(edit_images, change=lambda m: np.where(m > 127, 255, 0), kinds=("fg_masks",))
    yield (
        "coloured mattes of 3 channels",
        partial(edit_images, change=lambda m: np.repeat(m[..., None], 3, axis=2), kinds=("fg_masks",)),
    )


def _own_background(folder: Folder, background: float, foreground: float = 1.0) -> None:
    composite(folder, background, foreground)
    folder.options["background"] = background


def _keep_frames(folder: Folder, where: str) -> None:
    """Drop the entries whose image's name does not match."""
    edit_transforms(folder, lambda entries: [entry for entry in entries if re.search(where, entry["file_path"])])


def _crop(folder: Folder, left: int, top: int, right: int, bottom: int) -> None:
    edit_images(folder, lambda image: image[top : image.shape[0] - bottom, left : image.shape[1] - right],
                kinds=("images", "fg_masks"))  # fmt: skip
    update_frames(
        folder, cx=lambda x: x - left, cy=lambda y: y - top, w=lambda w: w - left - right, h=lambda h: h - top - bottom
    )


def _resize(folder: Folder, factor: float) -> None:
    def resize(image: np.ndarray) -> np.ndarray:
        size = round(image.shape[1] * factor), round(image.shape[0] * factor)
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA)

    edit_images(folder, resize, kinds=("images", "fg_masks"))
    edit_frames(
        folder,
        lambda entry: entry.update(
            {key: entry[key] * round(entry[size] * factor) / entry[size]
             for key, size in (("cx", "w"), ("cy", "h"), ("fl_x", "w"), ("fl_y", "h"))}
            | {key: round(entry[key] * factor) for key in ("w", "h")}
        ),
    )  # fmt: skip


def _renumber(folder: Folder) -> None:
    """Other numbers of cameras and timesteps, frames in random order."""
    random = np.random.default_rng(0)

    def change(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        for entry in entries:
            entry["camera_index"] = (7 * entry["camera_index"] + 3) % 97
            entry["timestep_index"] = 1000 - 10 * entry["timestep_index"]
        random.shuffle(entries)
        return entries

    edit_transforms(folder, change)


def _noise(sigma: float) -> Callable[[np.ndarray], np.ndarray]:
    random = np.random.default_rng(0)
    return lambda image: image + 255 * sigma * random.normal(size=image.shape)


def _random_gain(deviation: float) -> Callable[[np.ndarray], np.ndarray]:
    """Brightness of the foreground, image by image; white stays white."""
    random = np.random.default_rng(0)
    return lambda image: 255 * (image / 255) ** np.exp(deviation * random.normal())


def _camera_colours(folder: Folder, deviation: float) -> None:
    random = np.random.default_rng(0)
    for camera in sorted({file.name[6:8] for file in (folder.root / "images").iterdir()}):
        power = np.exp(deviation * random.normal(size=3))
        edit_images(folder, lambda image, p=power: 255 * (image / 255) ** p, f"_{camera}\\.")


def _jpeg(folder: Folder, quality: int) -> None:
    for file in sorted((folder.root / "images").iterdir()):
        pixels = cv2.imread(str(file))
        file.unlink()
        cv2.imwrite(str(file.with_suffix(".jpg")), pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    update_frames(folder, file_path=lambda name: name.replace(".png", ".jpg"))


def _tracking_noise(folder: Folder) -> None:
    random = np.random.default_rng(0)
    edit_parameters(
        folder,
        translation=lambda x: x + 0.0005 * random.normal(size=x.shape),
        rotation=lambda x: x + np.radians(0.3) * random.normal(size=x.shape),
        expr=lambda x: x * (1 + 0.05 * random.normal(size=x.shape)),
    )


def _below_line(folder: Folder, share: float) -> None:
    """Cut image and matte below a line, as GaussianAvatars' data do below the neck."""

    def cut(value: float, image: np.ndarray) -> np.ndarray:
        image[int(share * len(image)) :] = value
        return image

    edit_images(folder, partial(cut, 255))
    edit_images(folder, partial(cut, 0), kinds=("fg_masks",))


def _grow(pixels: int) -> Callable[[np.ndarray], np.ndarray]:
    kernel = np.ones((2 * abs(pixels) + 1,) * 2, np.uint8)
    return lambda matte: (cv2.dilate if pixels > 0 else cv2.erode)(matte, kernel)
