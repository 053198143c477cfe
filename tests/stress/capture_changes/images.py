"""Damages of images and mattes: their files, and what they show."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np

from stress.capture_changes.edits import BOTH, composite, edit_images
from stress.capture_changes.folder import Change, Folder, swap_files


def damages() -> Iterator[tuple[str, Change]]:
    """Damages of images, then of mattes.

    Yields:
        Name and change.
    """
    # Images
    yield "images are upside down", partial(edit_images, change=lambda image: image[::-1])
    yield "images and mattes are upside down", partial(edit_images, change=lambda image: image[::-1], kinds=BOTH)
    yield "images and mattes are mirrored", partial(edit_images, change=lambda image: image[:, ::-1], kinds=BOTH)
    yield "camera 5 is mirrored", partial(edit_images, change=lambda image: image[:, ::-1], where="_05", kinds=BOTH)
    yield (
        "an image has red and blue exchanged",
        partial(edit_images, change=lambda image: image[..., ::-1], where="00007_03"),
    )
    yield "an image is white", partial(edit_images, change=lambda image: image * 0 + 255, where="00007_03")
    yield "all images are black", partial(edit_images, change=lambda image: image * 0)
    yield "an image is overexposed", partial(edit_images, change=_brighter(1.8), where="00007_03")
    yield "an image is turned by 10 degrees", partial(edit_images, change=_turned, where="00007_03")
    yield "the background is black", partial(composite, background=0.0)
    yield "the background is stated as 0.5", lambda f: f.options.update(background=0.5)
    yield "the background is a studio", partial(edit_images, change=_studio)
    yield "two images of a camera are swapped", partial(swap_files, a="images/00004_03.png", b="images/00020_03.png")
    yield (
        "two images of a camera are swapped with their mattes",
        lambda f: (
            swap_files(f, "images/00004_03.png", "images/00020_03.png"),
            swap_files(f, "fg_masks/00004_03.png", "fg_masks/00020_03.png"),
        ),
    )
    yield "two neighbouring images are swapped", partial(swap_files, a="images/00004_03.png", b="images/00005_03.png")
    yield "two images of a timestep are swapped", partial(swap_files, a="images/00004_03.png", b="images/00004_04.png")
    yield "cameras 5 and 6 are swapped", lambda f: [_swap_cameras(f, 5, 6, kind) for kind in BOTH]
    yield (
        "an image is the copy of another camera's",
        partial(_copy_over, source="images/00004_03.png", target="images/00004_04.png"),
    )
    yield (
        "an image is the copy of another timestep's",
        partial(_copy_over, source="images/00004_03.png", target="images/00011_03.png"),
    )
    yield "an image is cut off", partial(_replace_bytes, name="images/00007_03.png", change=lambda b: b[: len(b) // 2])
    yield "a byte of an image is wrong", partial(_replace_bytes, name="images/00007_03.png", change=_flip_byte)
    yield "an image is smaller", partial(edit_images, change=lambda image: image[::2, ::2], where="00007_03")
    # Mattes
    yield "mattes are inverted", partial(edit_images, change=lambda matte: 255 - matte, kinds=("fg_masks",))
    yield "mattes are empty", partial(edit_images, change=lambda matte: 0 * matte, kinds=("fg_masks",))
    yield "mattes are full", partial(edit_images, change=lambda matte: 0 * matte + 255, kinds=("fg_masks",))
    yield "mattes are mirrored", partial(edit_images, change=lambda matte: matte[:, ::-1], kinds=("fg_masks",))
    yield (
        "mattes are 0 and 1, not 0 and 255",
        partial(edit_images, change=lambda matte: matte / 255, kinds=("fg_masks",)),
    )
    yield "a matte is empty", partial(edit_images, change=lambda m: 0 * m, where="00007_03", kinds=("fg_masks",))
    yield "the mattes of cameras 5 and 11 are swapped", partial(_swap_cameras, a=5, b=11, kind="fg_masks")
    yield (
        "two mattes of a camera are swapped",
        partial(swap_files, a="fg_masks/00004_03.png", b="fg_masks/00020_03.png"),
    )
    yield "a byte of a matte is wrong", partial(_replace_bytes, name="fg_masks/00007_03.png", change=_flip_byte)


def _swap_cameras(folder: Folder, a: int, b: int, kind: str) -> None:
    for file in sorted((folder.root / kind).glob(f"*_{a:02d}.*")):
        swap_files(folder, f"{kind}/{file.name}", f"{kind}/{file.name.replace(f'_{a:02d}.', f'_{b:02d}.')}")


def _replace_bytes(folder: Folder, name: str, change: Callable[[bytes], bytes]) -> None:
    file = folder.root / name
    content = change(file.read_bytes())
    file.unlink()
    file.write_bytes(content)


def _flip_byte(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 0x55]) + content[middle + 1 :]


def _copy_over(folder: Folder, source: str, target: str) -> None:
    content = (folder.root / source).read_bytes()
    (folder.root / target).unlink()
    (folder.root / target).write_bytes(content)


def _studio(image: np.ndarray) -> np.ndarray:
    """A backdrop that is neither even nor the stated one, where the image is white."""
    height, width = image.shape[:2]
    backdrop = 90 + 60 * np.linspace(0, 1, width)[None, :, None] + 40 * np.linspace(0, 1, height)[:, None, None]
    return np.where((image == 255).all(axis=2, keepdims=True), backdrop, image)


def _brighter(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda image: np.where((image == 255).all(axis=2, keepdims=True), 255, image * factor)


def _turned(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), 10, 1)
    return cv2.warpAffine(image, turn, (width, height), borderValue=(255, 255, 255))
