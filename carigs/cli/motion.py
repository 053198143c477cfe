"""`carigs motion`: read, edit and write motions.

IN is a motion (.npz, .csv, .json, or a folder of head parameters), `idle` or `talk`, or an avatar, of which it is the
captured motion. OUT is .npz or .csv; a name that ends with arkit.csv has the columns of Live Link Face. Without OUT the
command says what IN holds. docs/tutorials/talk.md shows what to do with it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from carigs.cli.options.motion import add_motion_options, driver_of, edited, edited_motion
from carigs.cli.options.parser import command_parser

if TYPE_CHECKING:
    from carigs.motion import Motion

EXAMPLES = """examples:
  carigs motion take.csv                              what it holds
  carigs motion take.csv take.npz --neutral 0.5 --smooth
  carigs motion avatar.npz captured.arkit.csv         for Unreal, Blender and Unity
  carigs motion talk talk.csv --seconds 5 --fps 60
"""


def motion(task: argparse.Namespace) -> None:
    """Read a motion, edit it, and write it or describe it.

    Args:
        task: The command line.

    Raises:
        InputError: For files that cannot be read or written.
        SettingsError: For values out of range.
    """
    from carigs.motion import editing, write_motion

    found = _captured(task) or edited_motion(task.input, task, driver_of(task), task.seconds)
    if task.fps is not None:
        found = editing.resampled(found, task.fps)
    if task.output is not None:
        write_motion(task.output, found)
    print(f"{task.output or task.input}: {len(found)} frames, {found.seconds:.2f} s at {found.fps:g} frames per second")
    if task.output is None:
        largest = np.abs(found.expression).max(axis=0)
        moving = [f"{found.names[i]} {largest[i]:.2f}" for i in np.argsort(-largest) if largest[i] > 0.005]
        print(f"expressions: {', '.join(moving) or 'none'}")
        turns = {"head": found.rotation, **found.joints}
        degrees = {name: np.degrees(np.ptp(rotations, axis=0).max()) for name, rotations in turns.items()}
        print(
            f"turns by degrees: {', '.join(f'{name} {angle:.0f}' for name, angle in degrees.items() if angle > 0.05)}"
        )


def _captured(task: argparse.Namespace) -> Motion | None:
    """The motion of an avatar, edited; None if the input is no avatar."""
    from carigs.readers.npz import read_npz

    file = Path(task.input)
    if file.suffix != ".npz" or not file.is_file():
        return None
    if not str(read_npz(file, only=("format",)).get("format", "")).startswith("carigs-avatar"):
        return None
    from carigs.library import load
    from carigs.motion.files import DEFAULT_FPS

    return edited(load(file).captured_motion(task.motion_fps or DEFAULT_FPS), task, task.seconds)


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("motion", __doc__, EXAMPLES)
    parser.add_argument("input", metavar="IN", help="a motion, idle, talk, or an avatar")
    parser.add_argument("output", type=Path, metavar="OUT", nargs="?", help=".npz, .csv or .arkit.csv")
    parser.add_argument("--fps", type=float, help="frames per second of OUT (default: those of IN)")
    parser.add_argument("--seconds", type=float, help="length: IN is cut, or repeated")
    add_motion_options(parser)
    motion(parser.parse_args(arguments))
    return 0
