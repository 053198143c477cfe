"""`carigs export`: a clip of a trained avatar, or the avatar itself as one HTML file.

OUT.html shows the avatar in any browser, with sliders for its exaggeration, without a server or a network. Its
options are --slider, --timesteps, --level and --fps; the others are those of clips.

OUT of a clip is .mp4 or .webm (VP9, for browsers and players), .webp or .gif. The sweep is what changes in it: the
exaggeration grows and falls (gamma), the camera goes around the head (orbit), or the head moves as it was captured
(sequence).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.progress import track

from carigs.cli.parser import command_parser, region_level
from carigs.errors import InputError, SettingsError

EXAMPLES = """examples:
  carigs export avatar.npz gamma.webp
  carigs export avatar.npz around.mp4 --sweep orbit --level 0.2 --seconds 6 --size 720
  carigs export avatar.npz talking.mp4 --sweep sequence --level 0.25 --azimuth 30
  carigs export avatar.npz nose.gif --sweep orbit --region nose=0.3 --degrees 120
  carigs export avatar.npz avatar.html
  carigs export avatar.npz avatar.html --slider nose --slider lips --timesteps 10:40
"""
MAX_SIZE, MAX_IMAGES = 4096, 100_000


def export(task: argparse.Namespace) -> None:
    """Write the clip or the page.

    Args:
        task: The command line.

    Raises:
        InputError: For files that cannot be read or written.
        SettingsError: For values out of range.
    """
    if task.output.suffix == ".html":
        return _export_html(task)
    from carigs.library import load, orbit
    from carigs.library.clips import ANIMATIONS, VIDEOS, captured_sequence, gamma_sweep, turntable, write_clip

    if task.output.suffix not in VIDEOS + ANIMATIONS:  # before the avatar is read
        raise InputError(f"a clip is one of {', '.join(VIDEOS + ANIMATIONS)}, a page is .html", file=task.output)
    if task.sliders or task.timesteps is not None:
        raise SettingsError(f"{'--slider' if task.sliders else '--timesteps'}: only OUT.html takes it")
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


def _export_html(task: argparse.Namespace) -> None:
    from carigs.library import load
    from carigs.viewer.html.page import write_html

    if task.regions or task.timestep is not None:
        raise SettingsError(
            f"{'--region' if task.regions else '--timestep'}: of clips; OUT.html has --slider, --timesteps"
        )
    avatar = load(task.avatar)
    timesteps = None if task.timesteps is None else clip_timesteps(task.timesteps, avatar.timesteps)
    write_html(
        avatar, task.output, timesteps=timesteps, regions=task.sliders or None, level=task.level, fps=task.fps
    )  # fmt: skip
    print(f"{task.output}: {len(avatar.avatar.surfels)} surfels, {task.output.stat().st_size / 1e6:.1f} MB")


def clip_timesteps(text: str, known: Sequence[int]) -> list[int]:
    """Read the timesteps of a clip.

    Args:
        text: FIRST:LAST (both belong to the clip, either may be missing), or numbers with commas between them.
        known: The avatar's timesteps, in ascending order.

    Returns:
        Timesteps, of FIRST:LAST those that are known.

    Raises:
        SettingsError: If it is something else.
    """
    first, colon, last = text.partition(":")
    try:
        if colon:
            low, high = int(first or known[0]), int(last or known[-1])
            return [t for t in known if low <= t <= high]
        return [int(number) for number in text.split(",")]
    except ValueError:
        raise SettingsError(f"--timesteps {text}: expected FIRST:LAST or numbers, as 10:40 or 0,4,8") from None


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("export", __doc__, EXAMPLES)
    parser.add_argument("avatar", type=Path, metavar="AVATAR", help="the avatar (.npz)")
    parser.add_argument("output", type=Path, metavar="OUT", help="the clip or the page")
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
    parser.add_argument(
        "--slider", dest="sliders", action="append", default=[], metavar="NAME",
        help="region that gets a slider in OUT.html (default: nose, lips, ears, forehead, eyes)",
    )  # fmt: skip
    parser.add_argument(
        "--timesteps", metavar="FIRST:LAST", help="clip in OUT.html, or numbers with commas (default: the first 30)"
    )
    export(parser.parse_args(arguments))
    return 0
