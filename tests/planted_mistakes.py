"""Mistakes that are planted into a dataset on disk, and what the diagnosis must say of them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

SPLITS = ("train", "val", "test")
OPENCV_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


def copy_dataset(source: Path, folder: Path, timesteps: range) -> Path:
    """Copy a dataset with some of its timesteps; the last one is the test split, images are links."""
    entries = [e for split in SPLITS for e in json.loads((source / f"transforms_{split}.json").read_text())["frames"]]
    entries = [entry for entry in entries if entry["timestep_index"] in timesteps]
    for entry in entries:
        for key in ("file_path", "fg_mask_path", "flame_param_path"):
            (folder / entry[key]).parent.mkdir(parents=True, exist_ok=True)
            if not (folder / entry[key]).exists():
                os.symlink((source / entry[key]).resolve(), folder / entry[key])
    last = max(entry["timestep_index"] for entry in entries)
    splits = {split: [e for e in entries if (e["timestep_index"] == last) == (split == "test")] for split in SPLITS}
    splits["val"] = []
    for split, frames in splits.items():
        (folder / f"transforms_{split}.json").write_text(json.dumps({"frames": frames}))
    return folder


def edit_entries(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    for split in SPLITS:
        file = folder / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            change(entry)
        file.write_text(json.dumps(content))


def fields(folder: Path, **values: Callable[[dict[str, Any]], Any]) -> None:
    """Set fields of all entries, each computed from the entry."""
    edit_entries(folder, lambda entry: entry.update({key: value(entry) for key, value in values.items()}))


def matrices(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    fields(folder, transform_matrix=lambda e: change(np.array(e["transform_matrix"])).tolist())


def millimetre_cameras(folder: Path) -> None:
    matrices(folder, lambda m: np.block([[m[:3, :3], 1000 * m[:3, 3:]], [m[3:]]]))


def millimetre_translations(folder: Path) -> None:
    for file in (folder / "flame_param").iterdir():
        with np.load(file) as content:
            arrays = dict(content)
        file.unlink()
        np.savez(file, **arrays | {"translation": 1000 * arrays["translation"]})


def pictures(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for kind in ("images", "fg_masks"):
        for file in (folder / kind).iterdir():
            pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            file.unlink()
            cv2.imwrite(str(file), change(pixels))


def crop(folder: Path, share: float = 0.1) -> None:
    """Cut off the top and the left of the images, so that principal points are off the middle."""
    entry = json.loads((folder / "transforms_train.json").read_text())["frames"][0]
    top, left = int(share * entry["h"]), int(share / 2 * entry["w"])
    pictures(folder, lambda image: image[top:, left:])
    fields(
        folder,
        cx=lambda e: e["cx"] - left,
        cy=lambda e: e["cy"] - top,
        w=lambda e: e["w"] - left,
        h=lambda e: e["h"] - top,
    )


def flipped_cy(folder: Path) -> None:
    crop(folder)
    fields(folder, cy=lambda e: e["h"] - e["cy"])


def scaled_intrinsics(folder: Path, factor: float) -> None:
    keys = ("fl_x", "fl_y", "cx", "cy")
    edit_entries(folder, lambda e: e.update({key: factor * e[key] for key in keys}))


def late_parameters(folder: Path, step: int) -> None:
    """Each timestep names the parameters of another one; the first or last keeps its own."""
    names: dict[int, str] = {}
    edit_entries(folder, lambda e: names.setdefault(e["timestep_index"], e["flame_param_path"]))
    fields(folder, flame_param_path=lambda e: names.get(e["timestep_index"] + step, names[e["timestep_index"]]))


def exchanged_cameras(folder: Path, a: int, b: int) -> None:
    poses: dict[int, Any] = {}
    edit_entries(folder, lambda e: poses.setdefault(e["camera_index"], e["transform_matrix"]))
    other = {a: b, b: a}
    fields(folder, transform_matrix=lambda e: poses[other.get(e["camera_index"], e["camera_index"])])


def field_of_view(key: str) -> Callable[[dict[str, Any]], float]:
    return lambda e: float(np.degrees(2 * np.arctan(e["w"] / (2 * e[key]))))


MISTAKES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "cameras in millimetres": (millimetre_cameras, "the positions of the cameras are in millimetres"),
    "translations in millimetres": (millimetre_translations, "the translations of the head are in millimetres"),
    "both in millimetres": (
        lambda folder: [millimetre_cameras(folder), millimetre_translations(folder)],
        "the positions of the cameras and the translations of the head are in millimetres",
    ),
    "OpenCV axes": (partial(matrices, change=lambda m: m @ OPENCV_AXES), "the cameras have OpenCV's axes"),
    "world-to-camera": (partial(matrices, change=np.linalg.inv), "the matrices are world-to-camera, not"),
    "OpenCV world-to-camera": (
        partial(matrices, change=lambda m: np.linalg.inv(m @ OPENCV_AXES)),
        "the matrices are world-to-camera with OpenCV's axes",
    ),
    "transposed rotations": (
        partial(matrices, change=lambda m: np.block([[m[:3, :3].T, m[:3, 3:]], [m[3:]]])),
        "the rotations are transposed",
    ),
    "mirrored y axis": (partial(matrices, change=lambda m: m * [1, -1, 1, 1]), "the y axis of the cameras is mirrored"),
    "negative fl_y": (partial(fields, fl_y=lambda e: -e["fl_y"]), "fl_y is negative"),
    "flipped cy": (flipped_cy, "cy counts from the bottom of the image"),
    "half resolution": (partial(scaled_intrinsics, factor=0.5), "the intrinsics belong to images of half"),
    "double resolution": (partial(scaled_intrinsics, factor=2), "the intrinsics belong to images of twice"),
    "late parameters": (partial(late_parameters, step=-1), "the head parameters are late by a timestep"),
    "early parameters": (partial(late_parameters, step=1), "the head parameters are early by a timestep"),
    "mirrored images": (partial(pictures, change=lambda image: image[:, ::-1]), "the images are mirrored"),
    "images upside down": (partial(pictures, change=lambda image: image[::-1]), "the images are upside down"),
    "exchanged cameras": (partial(exchanged_cameras, a=1, b=2), "the images of cameras 1, 2 are exchanged"),
    "fields of view in degrees": (
        partial(fields, fl_x=field_of_view("fl_x"), fl_y=field_of_view("fl_y")),
        "the focal lengths are fields of view in degrees over the image's width",
    ),
    "normalised focal lengths": (
        partial(fields, fl_x=lambda e: e["fl_x"] / e["w"], fl_y=lambda e: e["fl_y"] / e["h"]),
        "the focal lengths are shares of the image's width and height",
    ),
    "OpenCV axes in millimetres": (
        lambda folder: [millimetre_cameras(folder), matrices(folder, lambda m: m @ OPENCV_AXES)],
        "the cameras have OpenCV's axes (y down, z forward); the positions of the cameras are in millimetres",
    ),
}
"""By name the change of a folder, and how the diagnosis starts."""


def without_mattes(folder: Path) -> None:
    edit_entries(folder, lambda e: e.pop("fg_mask_path"))


SOUND: dict[str, Callable[[Path], Any]] = {
    "as it is": lambda folder: None,
    "off-centre principal point": crop,
    "flipped cy of a centred principal point": lambda folder: fields(folder, cy=lambda e: e["h"] - e["cy"]),
    "without mattes": without_mattes,
}
