"""`carigs export`: a clip of a trained avatar, or the avatar itself as one HTML file.

OUT.html shows the avatar in any browser, with sliders for its exaggeration, without a server or a network. Its
options are --slider, --timesteps, --level and --fps; the others are those of clips.

OUT of a clip is .mp4 or .webm (VP9, for browsers and players), .webp or .gif. The sweep is what changes in it: the
exaggeration grows and falls (gamma), the camera goes around the head (orbit), or the head moves as it was captured
(sequence). With --motion the head moves as a file says, or as one of the built-in motions idle and talk; OUT.html plays
any number of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import track

from carigs.cli.options.motion import add_motion_options, driver_of, edited_motion, has_edits, named_motions
from carigs.cli.options.parser import command_parser, region_level
from carigs.errors import InputError, SettingsError

if TYPE_CHECKING:
    from carigs.head import HeadModel
    from carigs.motion import Motion

EXAMPLES = """examples:
  carigs export avatar.npz gamma.webp
  carigs export avatar.npz around.mp4 --sweep orbit --level 0.2 --seconds 6 --size 720
  carigs export avatar.npz talking.mp4 --sweep sequence --level 0.25 --azimuth 30
  carigs export avatar.npz nose.gif --sweep orbit --region nose=0.3 --degrees 120
  carigs export avatar.npz take.mp4 --motion take.csv --level 0.25
  carigs export avatar.npz talk.webp --motion talk --seconds 3
  carigs export avatar.npz avatar.html
  carigs export avatar.npz avatar.html --motion take.csv --motion wait=idle --audio take.wav
  carigs export avatar.npz avatar.html --slider nose --slider lips --timesteps 10:40
"""
MAX_SIZE, MAX_IMAGES = 4096, 100_000
SECONDS, FPS = 4.0, 24.0
"""Length and images per second of clips without a motion."""


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
    if len(task.motions) > 1 or (task.motions and task.sweep):
        raise SettingsError("--motion: a clip shows one motion, without --sweep")
    if not task.motions and (has_edits(task) or task.audio):
        raise SettingsError("--motion is missing: edits and sound are those of a motion")
    if task.motions:
        return _export_motion(task)
    seconds = SECONDS if task.seconds is None else task.seconds
    fps = FPS if task.fps is None else task.fps
    if not 1 <= seconds * fps <= MAX_IMAGES:
        raise SettingsError(f"--seconds {seconds:g} at --fps {fps:g}: expected 1 to {MAX_IMAGES} images")
    if not 16 <= task.size <= MAX_SIZE:
        raise SettingsError(f"--size {task.size}: expected 16 to {MAX_SIZE} pixels")
    avatar, count = load(task.avatar), round(seconds * fps)
    level = avatar.gamma if task.level is None else task.level
    still = {"regions": dict(task.regions), "timestep": task.timestep}
    around = {"azimuth": task.azimuth, "elevation": task.elevation, "size": task.size}
    if task.sweep in (None, "gamma"):
        images = gamma_sweep(avatar, *orbit(avatar, 1, **around), count, level, **still)
    elif task.sweep == "orbit":
        images = turntable(avatar, orbit(avatar, count, degrees=task.degrees, **around), level=level, **still)
    else:
        if task.timestep is not None:
            raise SettingsError("--timestep: --sweep sequence shows all timesteps")
        del still["timestep"]
        count = len(avatar.timesteps)
        images = captured_sequence(avatar, *orbit(avatar, 1, **around), level=level, **still)
    written = write_clip(task.output, track(images, task.output.name, total=count, transient=True), fps)
    print(f"{task.output}: {written} images, {written / fps:.1f} s, {task.output.stat().st_size / 1e6:.1f} MB")


def _export_motion(task: argparse.Namespace) -> None:
    from carigs.library import load, orbit
    from carigs.library.clips import driven_sequence, write_clip
    from carigs.library.sound import add_sound, check_sound
    from carigs.motion import editing

    if not 16 <= task.size <= MAX_SIZE:
        raise SettingsError(f"--size {task.size}: expected 16 to {MAX_SIZE} pixels")
    if task.timestep is not None:
        raise SettingsError("--timestep: a motion shows its own frames")
    if task.audio is not None:
        check_sound(task.audio, task.output)
    driver, avatar = driver_of(task), load(task.avatar)
    motion = edited_motion(task.motions[0], task, driver, task.seconds)
    motion = editing.resampled(motion, motion.fps if task.fps is None else task.fps)
    if len(motion) > MAX_IMAGES:
        raise SettingsError(f"{len(motion)} images of the motion; at most {MAX_IMAGES} are written")
    level = avatar.gamma if task.level is None else task.level
    (camera,) = orbit(avatar, 1, azimuth=task.azimuth, elevation=task.elevation, size=task.size)
    images = driven_sequence(avatar, camera, motion, level=level, regions=dict(task.regions), driver=driver)
    bar = track(images, task.output.name, total=len(motion), transient=True)
    written = write_clip(task.output, bar, motion.fps)
    if task.audio is not None:
        add_sound(task.output, task.audio)
    print(f"{task.output}: {written} images, {motion.seconds:.1f} s, {task.output.stat().st_size / 1e6:.1f} MB")


def _export_html(task: argparse.Namespace) -> None:
    from carigs.library import load
    from carigs.viewer.html.page import write_html

    if task.regions or task.timestep is not None:
        raise SettingsError(
            f"{'--region' if task.regions else '--timestep'}: of clips; OUT.html has --slider, --timesteps"
        )
    driver, avatar = driver_of(task), load(task.avatar)
    motions, sounds = _page_motions(task, driver)
    fps = FPS if task.fps is None else task.fps
    timesteps = None if task.timesteps is None else clip_timesteps(task.timesteps, avatar.timesteps)
    write_html(
        avatar, task.output, timesteps=timesteps, regions=task.sliders or None, level=task.level, fps=fps,
        motions=motions, sounds=sounds, driver=driver,
    )  # fmt: skip
    print(f"{task.output}: {len(avatar.avatar.surfels)} surfels, {task.output.stat().st_size / 1e6:.1f} MB")


def _page_motions(
    task: argparse.Namespace, driver: HeadModel | None
) -> tuple[dict[str, Motion] | None, dict[str, Path]]:
    """Motions of a page by name, and the sound of the first; None for those that it has without any."""
    if not task.motions:
        if has_edits(task) or task.audio:
            raise SettingsError("--motion is missing: edits and sound are those of a motion")
        return None, {}
    motions = named_motions(task.motions, task, driver, task.seconds)
    return motions, {} if task.audio is None else {next(iter(motions)): task.audio}


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
    parser.add_argument("--sweep", choices=("gamma", "orbit", "sequence"), help="what changes (default gamma)")
    parser.add_argument("--level", type=float, help="exaggeration, or the highest one (default: that of the avatar)")
    parser.add_argument(
        "--region", dest="regions", type=region_level, action="append", default=[], metavar="NAME=LEVEL",
        help="level of a region, added to that of the head",
    )  # fmt: skip
    parser.add_argument("--timestep", type=int, help="of the expression and pose (default: the first)")
    parser.add_argument("--size", type=int, default=512, help="height and width in pixels (default %(default)s)")
    parser.add_argument("--fps", type=float, help=f"images per second (default {FPS:g}, or those of the motion)")
    parser.add_argument(
        "--seconds", type=float, help=f"of gamma and orbit (default {SECONDS:g}); a motion is cut or repeated"
    )
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
    parser.add_argument(
        "--motion", dest="motions", action="append", default=[], metavar="FILE",
        help="what drives the head: a file, a folder of head parameters, idle or talk; OUT.html takes several",
    )  # fmt: skip
    parser.add_argument("--audio", type=Path, metavar="FILE", help="sound of the motion, .wav or .mp3")
    add_motion_options(parser)
    export(parser.parse_args(arguments))
    return 0
