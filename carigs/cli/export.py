"""`carigs export`: a clip of a trained avatar.

OUT is .mp4 or .webm (VP9, for browsers and players), .webp or .gif. The sweep is what changes in the clip: the
exaggeration grows and falls (gamma), the camera goes around the head (orbit), or the head moves as it was captured
(sequence).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.progress import track

from carigs.cli.parser import command_parser, region_level
from carigs.errors import InputError, SettingsError

EXAMPLES = """examples:
  carigs export avatar.npz gamma.webp
  carigs export avatar.npz around.mp4 --sweep orbit --level 0.2 --seconds 6 --size 720
  carigs export avatar.npz talking.mp4 --sweep sequence --level 0.25 --azimuth 30
  carigs export avatar.npz nose.gif --sweep orbit --region nose=0.3 --degrees 120
"""
MAX_SIZE, MAX_IMAGES = 4096, 100_000


def export(task: argparse.Namespace) -> None:
    """Render and write the clip.

    Args:
        task: The command line.

    Raises:
        InputError: For files that cannot be read or written.
        SettingsError: For values out of range.
    """
    from carigs.library import load, orbit
    from carigs.library.clips import ANIMATIONS, VIDEOS, captured_sequence, gamma_sweep, turntable, write_clip

    if task.output.suffix not in VIDEOS + ANIMATIONS:  # before the avatar is read
        raise InputError(f"a clip is one of {', '.join(VIDEOS + ANIMATIONS)}", file=task.output)
    if not 1 <= task.seconds * task.fps <= MAX_IMAGES:
        raise SettingsError(f"--seconds {task.seconds:g} at --fps {task.fps:g}: expected 1 to {MAX_IMAGES} images")
    if not 16 <= task.size <= MAX_SIZE:
        raise SettingsError(f"--size {task.size}: expected 16 to {MAX_SIZE} pixels")
    avatar, count = load(task.avatar), round(task.seconds * task.fps)
    level = avatar.gamma if task.level is None else task.level
    still = {"regions": dict(task.regions), "timestep": task.timestep}
    around = {"azimuth": task.azimuth, "elevation": task.elevation, "size": task.size}
    if task.sweep == "gamma":
        images = gamma_sweep(avatar, *orbit(avatar, 1, **around), count, level, **still)
    elif task.sweep == "orbit":
        images = turntable(avatar, orbit(avatar, count, degrees=task.degrees, **around), level=level, **still)
    else:
        if task.timestep is not None:
            raise SettingsError("--timestep: --sweep sequence shows all timesteps")
        del still["timestep"]
        count = len(avatar.timesteps)
        images = captured_sequence(avatar, *orbit(avatar, 1, **around), level=level, **still)
    written = write_clip(task.output, track(images, task.output.name, total=count, transient=True), task.fps)
    print(f"{task.output}: {written} images, {written / task.fps:.1f} s, {task.output.stat().st_size / 1e6:.1f} MB")


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("export", __doc__, EXAMPLES)
    parser.add_argument("avatar", type=Path, metavar="AVATAR", help="the avatar (.npz)")
    parser.add_argument("output", type=Path, metavar="OUT", help="the clip")
    parser.add_argument(
        "--sweep", choices=("gamma", "orbit", "sequence"), default="gamma", help="(default %(default)s)"
    )
    parser.add_argument("--level", type=float, help="exaggeration, or the highest one (default: that of the avatar)")
    parser.add_argument(
        "--region", dest="regions", type=region_level, action="append", default=[], metavar="NAME=LEVEL",
        help="level of a region, added to that of the head",
    )  # fmt: skip
    parser.add_argument("--timestep", type=int, help="of the expression and pose (default: the first)")
    parser.add_argument("--size", type=int, default=512, help="height and width in pixels (default %(default)s)")
    parser.add_argument("--fps", type=float, default=24.0, help="images per second (default %(default)g)")
    parser.add_argument("--seconds", type=float, default=4.0, help="of gamma and orbit (default %(default)g)")
    parser.add_argument(
        "--azimuth",
        type=float,
        default=0.0,
        help="degrees from the front, positive to the left of the head (default %(default)g)",
    )
    parser.add_argument("--elevation", type=float, default=0.0, help="degrees above the horizon (default %(default)g)")
    parser.add_argument("--degrees", type=float, default=360.0, help="angle of the orbit (default %(default)g)")
    export(parser.parse_args(arguments))
    return 0
