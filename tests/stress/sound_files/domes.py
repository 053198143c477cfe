"""Captures of Ava-256 and Multiface, and what reads them."""

from __future__ import annotations

import contextlib
import io
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dome_captures import DomeBust, write_ava256, write_multiface

from carigs.capture import read_dataset
from carigs.capture.importers.ava256 import read_calibration, read_frame_list
from carigs.capture.importers.multiface import read_krt
from carigs.cli.conversion.captures import main as convert_capture
from carigs.errors import CarigsWarning

BUST = DomeBust(frames_per_segment=2, names=("400015", "400023"), segments=("EXP_neutral_peak", "EXP_free_face"))
AVA256 = "ava256/20230405--1635--AAN112/decoder"
MULTIFACE = "multiface/m--20180227--0000--6795937--GHS"


def write_sound_files(folder: Path) -> None:
    """Write a capture of each dataset.

    Args:
        folder: Where they are written.
    """
    write_ava256(folder / "ava256", BUST)
    write_multiface(folder / "multiface", BUST)


def _converted(source: str, *options: str) -> Callable[[Path], Any]:
    """`carigs convert` of a capture, some of whose files is given."""

    def convert(file: Path) -> Any:
        folder = next(place for place in file.parents if (place / source).is_dir())
        target = folder / "converted_dome"
        shutil.rmtree(target, ignore_errors=True)
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore", CarigsWarning)  # a damaged pose: the head lies on its side
            convert_capture([str(folder / source), str(target), "--stride", "1", "--copy", *options])
        capture = read_dataset(target, target / "head_model.npz")
        return [(frame, capture.image8(frame), capture.parameters(frame.timestep)) for frame in capture.frames]

    return convert


READERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "ava256 calibration": (read_calibration, f"{AVA256}/camera_calibration.json"),
    "ava256 frames": (read_frame_list, f"{AVA256}/frame_list.csv"),
    "ava256 undistorted": (_converted(AVA256, "--undistort"), f"{AVA256}/camera_calibration.json"),
    "ava256 topology": (_converted(AVA256), "ava256/face_topology.obj"),
    "ava256 head poses": (_converted(AVA256), f"{AVA256}/head_pose/head_pose.zip"),
    "ava256 meshes": (_converted(AVA256), f"{AVA256}/kinematic_tracking/registration_vertices.zip"),
    "ava256 images": (_converted(AVA256), f"{AVA256}/image/cam400015.zip"),
    "ava256 labels": (_converted(AVA256), f"{AVA256}/segmentation_parts/cam400015.zip"),
    "multiface calibration": (read_krt, f"{MULTIFACE}/KRT"),
    "multiface mesh": (_converted(MULTIFACE), f"{MULTIFACE}/tracked_mesh/EXP_free_face/000023.bin"),
    "multiface head pose": (_converted(MULTIFACE), f"{MULTIFACE}/tracked_mesh/EXP_free_face/000023_transform.txt"),
    "multiface image": (_converted(MULTIFACE), f"{MULTIFACE}/images/EXP_free_face/400015/000023.png"),
}
"""Function and file of each reader."""
