"""Changes of a sound capture: damages, which must be noticed, and oddities, which must be accepted."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from carigs.head.model_arrays import FLAME_NUM_IDENTITY

SPLITS = ("train", "val", "test")
OPENCV_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


class Folder(NamedTuple):
    """A copy of a capture."""

    root: Path
    model: Path
    options: dict[str, float]
    """Keywords of `read_dataset`."""


class Case(NamedTuple):
    """A change of a capture."""

    name: str
    change: Callable[[Folder], object]
    is_damage: bool
    """Whether the change must be refused or warned of; else it must be accepted without a word."""


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


def _edit_frames(folder: Folder, change: Callable[[dict[str, Any]], object], *, where: str = ".*") -> None:
    """Change the entries of frames whose image's name matches a regular expression."""
    for split in SPLITS:
        file = folder.root / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            if re.search(where, entry["file_path"]):
                change(entry)
        file.write_text(json.dumps(content))


def _update(folder: Folder, where: str = ".*", **values: Any) -> None:
    """Set or compute fields of the frames' entries."""

    def change(entry: dict[str, Any]) -> None:
        entry.update({key: value(entry[key]) if callable(value) else value for key, value in values.items()})

    _edit_frames(folder, change, where=where)


def _keep_frames(folder: Folder, where: str) -> None:
    """Drop the entries whose image's name does not match."""
    for split in SPLITS:
        file = folder.root / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        content["frames"] = [entry for entry in content["frames"] if re.search(where, entry["file_path"])]
        file.write_text(json.dumps(content))


def _move_cameras(folder: Folder, change: Callable[[np.ndarray], np.ndarray], where: str = ".*") -> None:
    """Change the camera-to-world matrices."""
    _update(folder, where, transform_matrix=lambda rows: change(np.array(rows)).tolist())


def _edit_images(
    folder: Folder, change: Callable[[np.ndarray], np.ndarray], where: str = ".*", kinds: tuple[str, ...] = ("images",)
) -> None:
    """Change the pixels of the images, or of the mattes, whose name matches."""
    for kind in kinds:
        for file in sorted((folder.root / kind).iterdir()):
            if re.search(where, file.name):
                pixels = change(cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.float64))
                file.unlink()
                cv2.imwrite(str(file), np.rint(np.clip(pixels, 0, 255)).astype(np.uint8))


def _swap(folder: Folder, a: str, b: str) -> None:
    """Exchange two files."""
    first, second, between = folder.root / a, folder.root / b, folder.root / "between"
    first.rename(between)
    second.rename(first)
    between.rename(second)


def _edit_arrays(file: Path, change: Callable[[dict[str, np.ndarray]], object]) -> None:
    """Change the arrays of an npz file."""
    with np.load(file, allow_pickle=False) as content:
        arrays = dict(content)
    change(arrays)
    file.unlink()
    np.savez(file, **arrays)


def _edit_parameters(folder: Folder, where: str = ".*", **values: Callable[[np.ndarray], Any]) -> None:
    """Change the head parameters of the timesteps that match."""
    for file in sorted((folder.root / "flame_param").iterdir()):
        if re.search(where, file.name):
            _edit_arrays(file, lambda arrays: arrays.update({k: np.asarray(v(arrays[k])) for k, v in values.items()}))


def _edit_model(folder: Folder, **values: Callable[[np.ndarray], Any]) -> None:
    """Change arrays of the head model."""
    _edit_arrays(folder.model, lambda arrays: arrays.update({k: np.asarray(v(arrays[k])) for k, v in values.items()}))


def _composite(folder: Folder, background: float, foreground: float = 1.0) -> None:
    """Put the foreground on another background, and scale its brightness."""
    for file in sorted((folder.root / "images").iterdir()):
        matte = cv2.imread(str(folder.root / "fg_masks" / file.name), cv2.IMREAD_GRAYSCALE)[..., None] / 255
        _edit_images(
            folder,
            lambda image, a=matte: foreground * (image - 255 * (1 - a)) + 255 * background * (1 - a),
            f"^{re.escape(file.name)}$",
        )


def _own_background(folder: Folder, background: float, foreground: float = 1.0) -> None:
    _composite(folder, background, foreground)
    folder.options["background"] = background


def _shift_parameters(folder: Folder) -> None:
    files = sorted((folder.root / "flame_param").iterdir())
    for a, b in pairwise(files):
        _swap(folder, f"flame_param/{a.name}", f"flame_param/{b.name}")


def _swap_cameras(folder: Folder, a: int, b: int, kind: str) -> None:
    for file in sorted((folder.root / kind).glob(f"*_{a:02d}.*")):
        _swap(folder, f"{kind}/{file.name}", f"{kind}/{file.name.replace(f'_{a:02d}.', f'_{b:02d}.')}")


def _exchange_poses(folder: Folder, a: int, b: int) -> None:
    poses: dict[int, Any] = {}
    _edit_frames(folder, lambda entry: poses.setdefault(entry["camera_index"], entry["transform_matrix"]))
    other = {a: b, b: a}
    _edit_frames(
        folder,
        lambda entry: entry.update(transform_matrix=poses[other.get(entry["camera_index"], entry["camera_index"])]),
    )


def _list_twice(folder: Folder) -> None:
    def change(content: list[dict[str, Any]]) -> list[dict[str, Any]]:
        copies = []
        for entry in content:
            if entry["camera_index"] == 3:
                name = entry["file_path"].replace("_03.", "_99.")
                if not (folder.root / name).exists():
                    shutil.copyfile(folder.root / entry["file_path"], folder.root / name)
                copies.append({**entry, "camera_index": 99, "file_path": name})
        return copies

    for split in SPLITS:
        file = folder.root / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        content["frames"] += change(content["frames"])
        file.write_text(json.dumps(content))


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


def _permuted(order: tuple[int, ...], axis: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: np.take(array, order, axis=axis)


def _crop(folder: Folder, left: int, top: int, right: int, bottom: int) -> None:
    _edit_images(folder, lambda image: image[top : image.shape[0] - bottom, left : image.shape[1] - right],
                kinds=("images", "fg_masks"))  # fmt: skip
    _update(
        folder, cx=lambda x: x - left, cy=lambda y: y - top, w=lambda w: w - left - right, h=lambda h: h - top - bottom
    )


def _resize(folder: Folder, factor: float) -> None:
    def resize(image: np.ndarray) -> np.ndarray:
        size = round(image.shape[1] * factor), round(image.shape[0] * factor)
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA)

    _edit_images(folder, resize, kinds=("images", "fg_masks"))
    _edit_frames(
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
    for split in SPLITS:
        file = folder.root / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            entry["camera_index"] = (7 * entry["camera_index"] + 3) % 97
            entry["timestep_index"] = 1000 - 10 * entry["timestep_index"]
        random.shuffle(content["frames"])
        file.write_text(json.dumps(content))


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
        _edit_images(folder, lambda image, p=power: 255 * (image / 255) ** p, f"_{camera}\\.")


def _jpeg(folder: Folder, quality: int) -> None:
    for file in sorted((folder.root / "images").iterdir()):
        pixels = cv2.imread(str(file))
        file.unlink()
        cv2.imwrite(str(file.with_suffix(".jpg")), pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    _update(folder, file_path=lambda name: name.replace(".png", ".jpg"))


def _tracking_noise(folder: Folder) -> None:
    random = np.random.default_rng(0)
    _edit_parameters(
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

    _edit_images(folder, partial(cut, 255))
    _edit_images(folder, partial(cut, 0), kinds=("fg_masks",))


def _grow(pixels: int) -> Callable[[np.ndarray], np.ndarray]:
    kernel = np.ones((2 * abs(pixels) + 1,) * 2, np.uint8)
    return lambda matte: (cv2.dilate if pixels > 0 else cv2.erode)(matte, kernel)


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


def _reordered(shapedirs: np.ndarray) -> np.ndarray:
    """Expressions that are not zero, in another order."""
    used = FLAME_NUM_IDENTITY + np.flatnonzero(np.abs(shapedirs[..., FLAME_NUM_IDENTITY:]).max(axis=(0, 1)))
    shapedirs[..., used] = shapedirs[..., np.roll(used, 7)]
    return shapedirs


BOTH = ("images", "fg_masks")
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def _damages() -> Iterator[tuple[str, Callable[[Folder], object]]]:
    # Cameras
    yield "fl_y is negative", partial(_update, fl_y=lambda f: -f)
    yield (
        "the last row of the matrices is 0 0 0 5",
        partial(_move_cameras, change=lambda m: np.vstack([m[:3], [0, 0, 0, 5]])),
    )
    yield "fl_x times 1.2", partial(_update, fl_x=lambda f: 1.2 * f)
    yield "fl_x and fl_y times 0.8", partial(_update, fl_x=lambda f: 0.8 * f, fl_y=lambda f: 0.8 * f)
    yield "fl_x of camera 5 times 1.15", partial(_update, where="_05", fl_x=lambda f: 1.15 * f, fl_y=lambda f: 1.15 * f)
    yield "fl_x as a share of the width", partial(_update, fl_x=lambda f: f / 275, fl_y=lambda f: f / 275)
    yield (
        "intrinsics of half the resolution",
        partial(_update, fl_x=lambda f: f / 2, fl_y=lambda f: f / 2, cx=lambda c: c / 2, cy=lambda c: c / 2),
    )
    yield "cx = cy = 0.5", partial(_update, cx=0.5, cy=0.5)
    yield "cx outside the image", partial(_update, cx=900.0)
    yield "cx + 12 pixels", partial(_update, cx=lambda c: c + 12)
    yield "cy - 14 pixels", partial(_update, cy=lambda c: c - 14)
    yield "cx of camera 5 + 24 pixels", partial(_update, where="_05", cx=lambda c: c + 24)
    yield "w and h exchanged", partial(_update, w=401, h=275)
    yield "matrices mirror", partial(_move_cameras, change=lambda m: m @ np.diag([-1.0, 1, 1, 1]))
    yield "matrices have OpenCV's axes", partial(_move_cameras, change=lambda m: m @ OPENCV_AXES)
    yield "matrices are world-to-camera", partial(_move_cameras, change=np.linalg.inv)
    yield (
        "rotations are transposed",
        partial(_move_cameras, change=lambda m: np.block([[m[:3, :3].T, m[:3, 3:]], [m[3:]]])),
    )
    yield (
        "matrices are in millimetres",
        partial(_move_cameras, change=lambda m: np.vstack([np.column_stack([m[:3, :3], 1000 * m[:3, 3]]), m[3:]])),
    )
    yield "camera 5 is turned by 180 degrees", partial(_move_cameras, change=lambda m: m @ HALF_TURN, where="_05")
    yield (
        "camera 5 is 4 cm off",
        partial(_move_cameras, change=lambda m: m + 0.04 * np.pad(np.ones((1, 1)), ((0, 3), (3, 0))), where="_05"),
    )
    yield "the poses of cameras 5 and 6 are exchanged", partial(_exchange_poses, a=5, b=6)
    yield "camera 3 is listed twice", _list_twice
    # Indexes and paths
    yield "an image is listed for two frames", partial(_update, where="00004_03", file_path="images/00004_04.png")
    yield "a timestep is 1.5", partial(_update, where="00001_03", timestep_index=1.5)
    yield "absolute paths", lambda f: _update(f, file_path=lambda name: str(f.root / name))
    yield "a path leaves the folder", partial(_update, where="00004_03", file_path="../../secret.png")
    # Head parameters
    yield "expressions of 1e6", partial(_edit_parameters, expr=lambda x: x * 0 + 1e6)
    yield "an expression times 12", partial(_edit_parameters, where="00007", expr=lambda x: 12 * x)
    yield "a rotation of 45 rad", partial(_edit_parameters, where="00007", rotation=lambda x: x * 0 + 45 / np.sqrt(3))
    yield (
        "rotations in degrees",
        partial(_edit_parameters, rotation=np.degrees, neck_pose=np.degrees, jaw_pose=np.degrees),
    )
    yield "a neck is turned by 2 rad", partial(_edit_parameters, where="00007", neck_pose=lambda x: x * 0 + [0, 2, 0])
    yield (
        "a rotation is 8 degrees off",
        partial(_edit_parameters, where="00007", rotation=lambda x: x + np.radians([[0, 8, 0]])),
    )
    yield "a translation of 1e30", partial(_edit_parameters, where="00007", translation=lambda x: x * 0 + 1e30)
    yield "translations in millimetres", partial(_edit_parameters, translation=lambda x: 1000 * (x + 0.01))
    yield "all translations are 4 cm off", partial(_edit_parameters, translation=lambda x: x + np.array([0.04, 0, 0]))
    yield (
        "a translation is 2 cm off",
        partial(_edit_parameters, where="00007", translation=lambda x: x + np.array([0.02, 0, 0])),
    )
    yield "a translation is not a number", partial(_edit_parameters, where="00007", translation=lambda x: x * np.nan)
    yield "a timestep has another shape", partial(_edit_parameters, where="00007", shape=lambda x: x + 0.1)
    yield (
        "static offsets in millimetres",
        lambda f: _edit_parameters(f, static_offset=lambda x: x + 20 * np.sin(np.arange(x.size)).reshape(x.shape)),
    )
    yield "two parameter files are swapped", partial(_swap, a="flame_param/00004.npz", b="flame_param/00020.npz")
    yield (
        "two neighbouring parameter files are swapped",
        partial(_swap, a="flame_param/00004.npz", b="flame_param/00005.npz"),
    )
    yield "parameter files are late by a timestep", _shift_parameters
    # Images
    yield "images are upside down", partial(_edit_images, change=lambda image: image[::-1])
    yield "images and mattes are upside down", partial(_edit_images, change=lambda image: image[::-1], kinds=BOTH)
    yield "images and mattes are mirrored", partial(_edit_images, change=lambda image: image[:, ::-1], kinds=BOTH)
    yield "camera 5 is mirrored", partial(_edit_images, change=lambda image: image[:, ::-1], where="_05", kinds=BOTH)
    yield (
        "an image has red and blue exchanged",
        partial(_edit_images, change=lambda image: image[..., ::-1], where="00007_03"),
    )
    yield "an image is white", partial(_edit_images, change=lambda image: image * 0 + 255, where="00007_03")
    yield "all images are black", partial(_edit_images, change=lambda image: image * 0)
    yield "an image is overexposed", partial(_edit_images, change=_brighter(1.8), where="00007_03")
    yield "an image is turned by 10 degrees", partial(_edit_images, change=_turned, where="00007_03")
    yield "the background is black", partial(_composite, background=0.0)
    yield "the background is stated as 0.5", lambda f: f.options.update(background=0.5)
    yield "the background is a studio", partial(_edit_images, change=_studio)
    yield "two images of a camera are swapped", partial(_swap, a="images/00004_03.png", b="images/00020_03.png")
    yield (
        "two images of a camera are swapped with their mattes",
        lambda f: (
            _swap(f, "images/00004_03.png", "images/00020_03.png"),
            _swap(f, "fg_masks/00004_03.png", "fg_masks/00020_03.png"),
        ),
    )
    yield "two neighbouring images are swapped", partial(_swap, a="images/00004_03.png", b="images/00005_03.png")
    yield "two images of a timestep are swapped", partial(_swap, a="images/00004_03.png", b="images/00004_04.png")
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
    yield "an image is smaller", partial(_edit_images, change=lambda image: image[::2, ::2], where="00007_03")
    # Mattes
    yield "mattes are inverted", partial(_edit_images, change=lambda matte: 255 - matte, kinds=("fg_masks",))
    yield "mattes are empty", partial(_edit_images, change=lambda matte: 0 * matte, kinds=("fg_masks",))
    yield "mattes are full", partial(_edit_images, change=lambda matte: 0 * matte + 255, kinds=("fg_masks",))
    yield "mattes are mirrored", partial(_edit_images, change=lambda matte: matte[:, ::-1], kinds=("fg_masks",))
    yield (
        "mattes are 0 and 1, not 0 and 255",
        partial(_edit_images, change=lambda matte: matte / 255, kinds=("fg_masks",)),
    )
    yield "a matte is empty", partial(_edit_images, change=lambda m: 0 * m, where="00007_03", kinds=("fg_masks",))
    yield "the mattes of cameras 5 and 11 are swapped", partial(_swap_cameras, a=5, b=11, kind="fg_masks")
    yield "two mattes of a camera are swapped", partial(_swap, a="fg_masks/00004_03.png", b="fg_masks/00020_03.png")
    yield "a byte of a matte is wrong", partial(_replace_bytes, name="fg_masks/00007_03.png", change=_flip_byte)
    # Head model
    yield "skinning weights times 7", partial(_edit_model, weights=lambda w: 7 * w)
    yield "skinning weights of zero", partial(_edit_model, weights=lambda w: 0 * w)
    yield "weights of neck and left eye exchanged", partial(_edit_model, weights=_permuted((0, 3, 2, 1, 4), 1))
    yield "weights of jaw and left eye exchanged", partial(_edit_model, weights=_permuted((0, 1, 3, 2, 4), 1))
    yield "a joint regressor of zeros", partial(_edit_model, J_regressor=lambda r: 0 * r)
    yield "joints of jaw and neck exchanged", partial(_edit_model, J_regressor=_permuted((0, 2, 1, 3, 4), 0))
    yield "a region of booleans", partial(_edit_model, mask_scalp=lambda ids: np.isin(np.arange(15602), ids))
    yield "a template in millimetres", partial(_edit_model, v_template=lambda v: 1000 * v)
    yield "blendshapes times 30", partial(_edit_model, shapedirs=lambda s: 30 * s)
    yield "faces are turned over", partial(_edit_model, f=lambda f: f[:, ::-1])
    yield "expressions in another order", partial(_edit_model, shapedirs=_reordered)


def _oddities() -> Iterator[tuple[str, Callable[[Folder], object]]]:
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
    yield "noise of 0.03", partial(_edit_images, change=_noise(0.03))
    yield "JPEG of quality 60", partial(_jpeg, quality=60)
    yield "blurred", partial(_edit_images, change=lambda image: cv2.GaussianBlur(image, (0, 0), 1.5))
    yield "grey images", partial(_edit_images, change=lambda i: np.repeat(i.mean(axis=2, keepdims=True), 3, axis=2))
    yield "flicker of 5 %", partial(_edit_images, change=_random_gain(0.05))
    yield "cameras of different colours", partial(_camera_colours, deviation=0.1)
    yield "tracking noise", _tracking_noise
    yield "cut below the neck", partial(_below_line, share=0.8)
    yield "mattes grown by 2 pixels", partial(_edit_images, change=_grow(2), kinds=("fg_masks",))
    yield "mattes shrunk by 2 pixels", partial(_edit_images, change=_grow(-2), kinds=("fg_masks",))
    yield "hard mattes", partial(_edit_images, change=lambda m: np.where(m > 127, 255, 0), kinds=("fg_masks",))
    yield (
        "coloured mattes of 3 channels",
        partial(_edit_images, change=lambda m: np.repeat(m[..., None], 3, axis=2), kinds=("fg_masks",)),
    )


def cases() -> list[Case]:
    """All changes.

    Returns:
        Damages, then oddities.
    """
    return [Case(*pair, True) for pair in _damages()] + [Case(*pair, False) for pair in _oddities()]
