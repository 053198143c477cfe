"""`carigs matte`: make frames and mattes of a video, or of a folder of photographs.

The frames are upright, of one size, and composited on a grey. FOLDER/images and FOLDER/masks have the names that
`carigs fit` and `carigs convert` read.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from carigs.capture.images import read_grey, write_png
from carigs.cli.options.parser import command_parser, grey_value
from carigs.detection import load_face_networks
from carigs.errors import CarigsError, CarigsWarning, InputError, PackageMissing, WeightsMissing
from carigs.footage import Footage, Selection, TimedFrame, read_footage
from carigs.footage.photographs import SUFFIXES
from carigs.matting import composite, given_mattes, matted_frames
from carigs.readers.folders import listed, natural_order
from carigs.system.files import writing_folder
from carigs.tracking.sources import set_upright

EXAMPLES = """examples:
  carigs matte me.mp4 -o frames                       before a plain wall
  carigs matte me.mp4 -o frames --coarse network      mattes of a network, which are refined
  carigs matte photographs -o frames --alpha mattes   mattes that are used as they are

docs/footage.md says what is read, and how mattes are made.
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.

    Raises:
        CarigsError: If the output is not empty, or the footage or a matte cannot be used.
    """
    task = _parser().parse_args(arguments)
    if task.output.exists() and any(task.output.iterdir()):
        raise CarigsError(f"{task.output}: the folder is not empty; name a new one")
    selection = Selection(task.every, task.start, task.end, task.max_frames, task.largest_side)
    footage = read_footage(task.source, selection)
    if not (task.alpha or task.coarse):  # mattes that are given lie as the frames do
        footage = _set_upright(footage)
    for line in footage.warnings:
        warnings.warn(CarigsWarning(line), stacklevel=2)
    if task.alpha:
        found = given_mattes(footage, _mattes(task.alpha, footage))
    else:
        found = matted_frames(footage, task.coarse and _mattes(task.coarse, footage))
    console = Console(stderr=True)
    with writing_folder(task.output) as part:
        for name in ("images", "masks"):
            (part / name).mkdir()
        quiet = not sys.stderr.isatty()
        for frame, alpha, foreground in track(
            found, "matting", len(footage), console=console, transient=True, disable=quiet
        ):
            name = f"{frame.number:05d}_00.png"
            write_png(part / "images" / name, composite(foreground, alpha, task.background) / 255.0)
            write_png(part / "masks" / name, alpha)
    print(f"{task.output}: {len(footage)} frames of {footage.width} x {footage.height} pixels")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("matte", __doc__, EXAMPLES)
    parser.add_argument("source", type=Path, metavar="VIDEO|FOLDER", help="a video, or PNG and JPEG images")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="new or empty")
    given = parser.add_mutually_exclusive_group()
    given.add_argument("--coarse", type=Path, metavar="FOLDER", help="a coarse matte per frame, of any resolution")
    given.add_argument("--alpha", type=Path, metavar="FOLDER", help="a matte per frame that is right as it is")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="use every n-th frame")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="seconds after the first frame")
    parser.add_argument("--end", type=float, metavar="S", help="seconds after the first frame")
    parser.add_argument("--max-frames", type=int, metavar="N", help="most frames, evenly spread")
    parser.add_argument("--largest-side", type=int, metavar="PIXELS", help="scale larger frames down")
    parser.add_argument(
        "--background", type=grey_value, default=1.0, metavar="GREY", help="behind the person (default: 1, white)"
    )
    return parser


def _set_upright(footage: Footage) -> Footage:
    """Turn frames that lie on the side, or upside down; as they are without the networks that find faces."""
    try:
        networks = load_face_networks()
    except (PackageMissing, WeightsMissing):
        return footage
    return set_upright(footage, networks)


def _mattes(folder: Path, footage: Footage) -> Callable[[TimedFrame], np.ndarray]:
    """Mattes of a folder, one for each frame in the natural order of their names."""
    files = sorted((file for file in listed(folder) if file.suffix.lower() in SUFFIXES), key=natural_order)
    if len(files) != len(footage):
        raise InputError(f"{len(files)} mattes for {len(footage)} frames", file=folder)
    of_frame = dict(zip(footage.numbers, files, strict=True))
    return lambda frame: read_grey(of_frame[frame.number])
