"""`carigs landmarks`: find the landmarks of a face in a video, or in a folder of images."""

from __future__ import annotations

import itertools
import sys
import warnings
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from rich.console import Console
from rich.progress import track

from carigs.capture.images import read_rgb8
from carigs.capture.importers.images import SUFFIXES, find_images
from carigs.cli.options.parser import command_parser
from carigs.detection import FaceNetworks, FaceTrack, collect, follow_face, load_face_networks
from carigs.detection.upright import follow_upright
from carigs.errors import CarigsWarning, InputError
from carigs.fitting.landmarks.files import Landmarks
from carigs.fitting.landmarks.providers import confident_points
from carigs.footage import Footage
from carigs.footage.video import read_video
from carigs.readers.folders import listed, natural_order
from carigs.tracking.sources import set_upright

EXAMPLES = """examples:
  carigs weights fetch mediapipe_face
  carigs landmarks me.mp4 -o landmarks.npz
  carigs landmarks video/images -o landmarks.npz

The file has the 478 landmarks of MediaPipe's face mesh, as `carigs fit` reads them (docs/landmarks.md).
"""


class Camera(NamedTuple):
    """The images of a camera."""

    name: str
    timesteps: list[int] | None
    """Of each image; None if they count from 0."""
    images: Callable[[], Iterable[UInt8[np.ndarray, "h w 3"]]]
    """Gives them, decoded one after the other."""
    video: Footage | None = None
    """Where they come from, if not from files."""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.

    Raises:
        InputError: If the output is no .npz file, the source cannot be read, or no image shows a face.
    """
    parser = command_parser("landmarks", __doc__, EXAMPLES)
    parser.add_argument(
        "source",
        type=Path,
        help="a video; or a folder of images named CAMERA/TIMESTEP, TIMESTEP_CAMERA, or in the order of one camera",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help=".npz file to write")
    parser.add_argument("--weights", metavar="DIR", help="folder of weights that is searched first")
    task = parser.parse_args(arguments)
    if task.output.suffix != ".npz":
        raise InputError("landmarks are written as .npz", file=task.output)
    cameras = _cameras(task.source)
    networks = load_face_networks(task.weights)
    tracks = []
    for camera in cameras:
        found, note = _follow(camera, networks)
        tracks.append(found)
        if note:
            warnings.warn(CarigsWarning(note), stacklevel=2)
    landmarks = _together(cameras, tracks)
    if not landmarks.values.any():
        raise InputError(f"no face in any of {sum(len(t.found) for t in tracks)} images", file=task.source)
    landmarks.save(task.output)
    for camera, found in zip(cameras, tracks, strict=True):
        for note in found.notes():
            warnings.warn(CarigsWarning(f"camera {camera.name}: {note}"), stacklevel=2)
    count = sum(int(found.found.sum()) for found in tracks)
    print(f"{task.output}: landmarks of {count} of {sum(len(found.found) for found in tracks)} images")
    return 0


def _follow(camera: Camera, networks: FaceNetworks) -> tuple[FaceTrack, str]:
    """Landmarks of a camera, and a line if its images are not upright.

    Those of a video are in its frames as they are set upright, which `carigs matte` and `carigs track` write. Files of
    images stay as they are, and calibrations refer to them.
    """

    def shown(images: Iterable[UInt8[np.ndarray, "h w 3"]]) -> Iterable[UInt8[np.ndarray, "h w 3"]]:
        quiet = not sys.stderr.isatty()
        return track(images, f"camera {camera.name}", console=Console(stderr=True), disable=quiet)

    if camera.video is None:
        found, turns = follow_upright(lambda: shown(camera.images()), networks)
        lies = "upside down" if turns == 2 else "on the side"
        note = f"camera {camera.name}: faces are {lies}; landmarks are those of the images as they are"
        return found, note if turns else ""
    upright = set_upright(camera.video, networks)
    return collect(follow_face(shown(upright.decode()), networks)), "; ".join(
        line for line in upright.warnings if line not in camera.video.warnings
    )


def _cameras(source: Path) -> list[Camera]:
    """Cameras in the order of their names, which is that of their numbers in a dataset."""
    if not source.is_dir():
        footage = read_video(source)
        for line in footage.warnings:
            warnings.warn(CarigsWarning(line), stacklevel=2)
        return [Camera("0", list(footage.numbers), footage.decode, footage)]
    files = [file for file in listed(source) if file.suffix.lower() in SUFFIXES]
    if any("_" not in file.stem or not file.stem.split("_")[0].isdecimal() for file in files):
        return [Camera("0", None, partial(map, read_rgb8, sorted(files, key=natural_order)))]
    by_camera = itertools.groupby(sorted(find_images(source), key=lambda image: image.camera), lambda i: i.camera)
    return [_camera(name, list(images)) for name, images in by_camera]


def _camera(name: str, images: list) -> Camera:
    ordered = sorted(images, key=lambda image: image.timestep)
    files = [image.file for image in ordered]
    return Camera(name, [image.timestep for image in ordered], partial(map, read_rgb8, files))


def _together(cameras: list[Camera], tracks: list[FaceTrack]) -> Landmarks:
    """Landmarks of all cameras; 0 where a camera lacks a timestep."""
    timesteps = [camera.timesteps or list(range(len(own.found))) for camera, own in zip(cameras, tracks, strict=True)]
    every = sorted(set().union(*timesteps))
    row = {timestep: i for i, timestep in enumerate(every)}
    values = np.zeros((len(every), len(cameras), *tracks[0].landmarks.shape[1:]))
    for column, (own, found) in enumerate(zip(timesteps, tracks, strict=True)):
        values[[row[timestep] for timestep in own], column] = confident_points(found)
    return Landmarks(values, np.array(every), np.arange(len(cameras)))
