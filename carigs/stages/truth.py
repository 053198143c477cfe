"""Stage `truth`: ground-truth images of the test frames at one level; used for evaluation only."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

from rich.progress import track

from carigs.capture import Camera, Capture
from carigs.capture.dataset_paths import file_inside
from carigs.capture.frame_index import ground_truth_files, write_ground_truth
from carigs.capture.images import write_png
from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.head import read_subject_path
from carigs.readers.file_names import TRUE_FRAMES
from carigs.readers.images import read_pixels
from carigs.readers.json_files import json_field, read_json
from carigs.settings import Truth
from carigs.system.files import writing_folder

Keys = Iterator[tuple[int, int]]
"""Timestep and camera of each image, once it is written."""


def truth(settings: Truth, *, capture: Path, path: Path, level: float, frames: Path, index: Path) -> None:
    """Write the ground-truth images of a level, or the reason why there are none.

    Level 0 is the capture itself (test and val frames). Other levels are rendered for the toy, read from
    `settings.folder`, or unknown, as for every real person.

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path.
        level: Exaggeration level.
        frames: Output: folder of images and masks.
        index: Output: timestep, camera and files of each image, or the reason.
    """
    subject, reason = Capture.load(capture), None
    with writing_folder(frames) as part:
        if level == 0:
            keys = _copy_captured(subject, part)
        elif (subject.root / "subject.npz").is_file():
            keys = _render_toy(subject, read_subject_path(path, subject.model).at(level), part)
        elif settings.folder and (folder := Path(settings.folder.replace("{level}", f"{level:g}"))).is_dir():
            keys = _copy_supplied(subject, folder, part)
        else:
            keys, reason = iter(()), "no true caricature of this subject at this level"
        written = list(keys)
    write_ground_truth(index, level, written, reason)


def _copy_captured(subject: Capture, folder: Path) -> Keys:
    for frame in (*subject.split("test"), *subject.split("val")):
        files = ground_truth_files(frame.timestep, frame.camera)
        for key, file, read in (
            ("image", frame.image, subject.image),
            ("mask", frame.mask, subject.foreground),
        ):
            if file is None or frame.mask == frame.image:  # an alpha channel, or no matte
                write_png(folder / files[key], read(frame))
            else:
                _copy_image(subject.root / file, folder / files[key], subject.camera(frame))
        yield frame.timestep, frame.camera


def _render_toy(subject: Capture, caricature: Caricature, folder: Path) -> Keys:
    from carigs.toy import load_subject, pose_subject

    toy, frames = load_subject(subject.root), subject.split("test")
    posed = None
    for frame in track(frames, description="truth", disable=len(frames) < 10):
        if posed is None or posed[0] != frame.timestep:  # frames are in order of their timestep
            posed = frame.timestep, pose_subject(toy, subject.parameters(frame.timestep), caricature)
        colour, alpha = posed[1].render(subject.camera(frame))
        files = ground_truth_files(frame.timestep, frame.camera)
        write_png(folder / files["image"], colour)
        write_png(folder / files["mask"], alpha)
        yield frame.timestep, frame.camera


def _copy_supplied(subject: Capture, source: Path, folder: Path) -> Keys:
    """Copy images from a folder with an index in the format of GaussianAvatars."""
    index = source / TRUE_FRAMES
    for i, entry in enumerate(read_json(index, list)):
        where = f"[{i}]"
        timestep = json_field(entry, "timestep_index", int, file=index, where=where)
        number = json_field(entry, "camera_index", int, file=index, where=where)
        if number not in subject.cameras:
            raise InputError(f"the capture has no camera {number}", file=index, field=f"{where}.camera_index")
        frame = subject.frame_at.get((timestep, number))
        if frame is None:  # left out of the capture by its stride or number of frames
            continue
        names = ground_truth_files(timestep, number)
        for key, name in (("file_path", names["image"]), ("fg_mask_path", names["mask"])):
            file = file_inside(json_field(entry, key, str, file=index, where=where), index, f"{where}.{key}")
            _copy_image(source / file, folder / name, subject.camera(frame))
        yield timestep, number


def _copy_image(source: Path, target: Path, camera: Camera) -> None:
    """Copy a file that decodes as an image of the camera's size: other files have no business in results."""
    height, width = read_pixels(source).shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(f"its camera has {camera.width} x {camera.height} pixels", file=source)
    shutil.copyfile(source, target)
