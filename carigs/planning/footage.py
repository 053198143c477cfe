"""Number and size of a subject's images, as far as they are known before its capture is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.readers.json_files import read_json


@dataclass(frozen=True)
class Footage:
    """Images of a subject."""

    train: int
    """Images that training and GT* read."""
    evaluated: int
    """Images of the splits `val` and `test`, which are rendered and measured."""
    megapixels: float
    """Size of one image."""
    source: str
    """Where the numbers come from."""


ASSUMED = Footage(train=13_500, evaluated=2_900, megapixels=802 * 550 / 1e6, source="assumed: a NeRSemble sequence")
"""A subject whose data are not here: 15 training cameras of 802x550 at 900 timesteps, 500 + 150 x 16 images for
evaluation."""


def subject_footage(capture: DictConfig, index: Path) -> Footage:
    """Count the images of a subject.

    Args:
        capture: Composed section `capture`.
        index: Where the stage `capture` writes the index.

    Returns:
        Counts from the index; before there is one, from the toy's settings or the dataset's folder; else `ASSUMED`.
    """
    if index.is_file():
        subject = Capture.load(index)
        train, camera = len(subject.split("train")), subject.camera(subject.frames[0])
        size = camera.width * camera.height / 1e6
        return Footage(train, len(subject.frames) - train, size, f"counted in {index}")
    if capture.source == "toy":
        toy = capture.toy
        steps, cameras = toy.steps_per_sequence, toy.cameras
        train, evaluated = 9 * steps * max(cameras - 1, 1), 9 * steps + steps * cameras  # nine of ten sequences train
        return Footage(train, evaluated, toy.width * toy.height / 1e6, "from capture.toy")
    try:
        return _folder_footage(Path(capture.folder), capture.stride, capture.max_frames)
    except (InputError, KeyError, TypeError):
        return ASSUMED


def _folder_footage(folder: Path, stride: int, max_frames: int | None) -> Footage:
    """Count the images of a folder in the layout of GaussianAvatars that stride and limit keep."""
    indexes = {split: read_json(folder / f"transforms_{split}.json", dict) for split in ("train", "val", "test")}
    strided = {split: -(-len(index["frames"]) // stride) for split, index in indexes.items()}
    counts = {split: min(count, max_frames or count) for split, count in strided.items()}
    first = indexes["train"]
    size = {**first, **(first["frames"][0] if first["frames"] else {})}
    return Footage(counts["train"], counts["val"] + counts["test"], size["w"] * size["h"] / 1e6, f"counted in {folder}")
