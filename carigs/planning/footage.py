"""Number and size of a subject's images, as far as they are known before its capture is read.

Every run counts them when it starts. What reads captures and videos takes half a second to import, and is imported
where it is needed: the first run of most studies needs neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from omegaconf import DictConfig

from carigs.errors import CarigsError, InputError
from carigs.readers.file_names import INDEXES
from carigs.readers.json_files import read_json


@dataclass(frozen=True)
class Footage:
    """Images of a subject."""

    train: int
    """Images that training and GT* read."""
    val: int
    """Images of the held-out camera, which are rendered at level 0."""
    test: int
    """Images of the held-out sequence."""
    cameras: int
    """Cameras of the held-out sequence."""
    megapixels: float
    """Size of one image."""
    source: str
    """Where the numbers come from."""

    def rendered(self, level: float, timesteps: int | None) -> int:
        """Count the frames of the capture that are rendered and measured.

        Args:
            level: Rendered level.
            timesteps: Setting `render.test_timesteps`.

        Returns:
            Number of images, without those of the orbit.
        """
        test = self.test if timesteps is None else min(self.test, timesteps * self.cameras)
        return test + (self.val if level == 0 else 0)


ASSUMED = Footage(13_500, 500, 2_400, 16, 802 * 550 / 1e6, "assumed: a NeRSemble sequence")
"""A subject whose data are not here: 15 training cameras of 802x550 at 900 timesteps, 500 images of the held-out camera
and 150 x 16 of the held-out sequence."""


def subject_footage(settings: DictConfig, index: Path) -> Footage:
    """Count the images of a subject.

    Args:
        settings: Composed settings of the subject.
        index: Where the stage `capture` writes the index.

    Returns:
        Counts from the index; before there is one, from the toy's settings, the dataset's folder or the video; else
        `ASSUMED`.
    """
    if index.is_file():
        from carigs.capture import Capture

        subject = Capture.load(index)
        train, val, test = (subject.split(name) for name in ("train", "val", "test"))
        camera, cameras = subject.camera(subject.frames[0]), len({frame.camera for frame in test})
        size = camera.width * camera.height / 1e6
        return Footage(len(train), len(val), len(test), cameras, size, f"counted in {index}")
    capture = settings.capture
    if capture.source == "toy":
        toy = capture.toy
        steps, cameras = toy.steps_per_sequence, toy.cameras
        held_out = cameras > 5  # of few cameras, as `carigs.toy.scene.split_names` knows, nearly all frames train
        train = 9 * steps * (cameras - held_out)  # nine of ten sequences train
        size = toy.width * toy.height / 1e6
        return Footage(train, 9 * steps * held_out, steps * cameras, cameras, size, "from capture.toy")
    if capture.source == "video":
        return _video_footage(settings.track)
    try:
        return _folder_footage(Path(capture.folder), capture.stride, capture.max_frames)
    except (InputError, KeyError, TypeError):
        return ASSUMED


def _video_footage(track: DictConfig) -> Footage:
    """Count the frames of a video that are tracked."""
    from carigs.footage import Selection
    from carigs.footage.photographs import each_photograph
    from carigs.tracking.held_out import SPLITS, held_out
    from carigs.tracking.kinds import AUTO, PHOTOGRAPHS
    from carigs.tracking.sources import camera_sources, chosen_frames

    try:
        sources = camera_sources(Path(track.video))
        if track.footage == PHOTOGRAPHS or (len(sources) == 1 and sources[0].is_dir() and track.footage == AUTO):
            images = each_photograph(sources[0], Selection(largest_side=track.largest_side))
            first, count, cameras = images[0], 1, len(images)
        else:
            first = chosen_frames(sources[0], track.frame_rate, track.largest_side)
            count, cameras = len(first), len(sources)
    except CarigsError:  # the stage says what is wrong with it
        return ASSUMED
    splits = [*chain.from_iterable(held_out(count, cameras, cameras // 2, SPLITS[track.held_out]))]
    counts = (splits.count(name) for name in ("train", "val", "test"))
    return Footage(*counts, cameras, first.width * first.height / 1e6, f"counted in {track.video}")


def _folder_footage(folder: Path, stride: int, max_frames: int | None) -> Footage:
    """Count the images of a folder in the layout of GaussianAvatars that stride and limit keep."""
    indexes = {split: read_json(folder / name, dict) for split, name in INDEXES.items()}
    strided = {split: -(-len(index["frames"]) // stride) for split, index in indexes.items()}
    counts = {split: min(count, max_frames or count) for split, count in strided.items()}
    first, tested = indexes["train"], indexes["test"]["frames"]
    cameras = len({frame.get("camera_index") for frame in tested})
    size = {**first, **(first["frames"][0] if first["frames"] else {})}
    megapixels = size["w"] * size["h"] / 1e6
    return Footage(counts["train"], counts["val"], counts["test"], cameras, megapixels, f"counted in {folder}")
