"""Options of commands that take a motion."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.cli.options.parser import region_level
from carigs.errors import InputError, SettingsError

if TYPE_CHECKING:
    from carigs.head import HeadModel
    from carigs.motion import Motion

MAX_SECONDS = 3600.0


def add_motion_options(parser: argparse.ArgumentParser) -> None:
    """Add the edits of a motion.

    Args:
        parser: Receives `driver`, `motion_fps`, `mirror`, `smooth`, `neutral`, `strengths`, `start` and `end`.
    """
    group = parser.add_argument_group("motion")
    group.add_argument("--driver", type=Path, metavar="FILE", help="head model that a motion of numbers belongs to")
    group.add_argument("--motion-fps", type=float, metavar="N", help="frames per second of a file that states no times")
    group.add_argument("--mirror", action="store_true", help="exchange left and right")
    group.add_argument("--smooth", action="store_true", help="smooth what trembles")
    group.add_argument("--neutral", type=float, metavar="SECONDS", help="when the driver's face rests")
    group.add_argument(
        "--strength", dest="strengths", type=region_level, action="append", default=[], metavar="PART=FACTOR",
        help="of eyes, brows, mouth, jaw, cheeks, gaze, head, pitch, yaw or roll, as mouth=1.3 or yaw=-1",
    )  # fmt: skip
    group.add_argument("--start", type=float, default=0.0, metavar="SECONDS", help="where the motion begins")
    group.add_argument("--end", type=float, metavar="SECONDS", help="where it ends")


def has_edits(task: argparse.Namespace) -> bool:
    """Whether an edit of a motion is asked for.

    Args:
        task: The command line.

    Returns:
        Whether an option of `add_motion_options` has another value than its default.
    """
    edits = (task.driver, task.motion_fps, task.neutral, task.end)
    return any(edit is not None for edit in edits) or bool(task.mirror or task.smooth or task.strengths or task.start)


def driver_of(task: argparse.Namespace) -> HeadModel | None:
    """The head model of the driver.

    Args:
        task: The command line.

    Returns:
        The model that `--driver` names; None without it.

    Raises:
        InputError: If it cannot be read.
    """
    from carigs.head import HeadModel

    return None if task.driver is None else HeadModel.load(task.driver)


def edited_motion(name: str, task: argparse.Namespace, driver: HeadModel | None, seconds: float | None) -> Motion:
    """Read a motion and edit it as the command line says.

    Args:
        name: A file, or the name of a built-in motion.
        task: The command line.
        driver: Head model of the driver.
        seconds: Length of a built-in motion, or to which another one is repeated; None for its own.

    Returns:
        The motion.

    Raises:
        InputError: If the file cannot be read.
        SettingsError: If an option is out of range.
    """
    from carigs.motion import BUILT_IN, read_motion

    check_length(seconds)
    if name in BUILT_IN and not Path(name).exists():
        motion = BUILT_IN[name]() if seconds is None else BUILT_IN[name](seconds)
    elif not Path(name).exists() and not Path(name).suffix:
        raise InputError(f"no such motion; built in are {' and '.join(BUILT_IN)}", file=name)
    else:
        motion = read_motion(name, fps=task.motion_fps, head=driver)
    return edited(motion, task, seconds)


def named_motions(
    texts: Sequence[str], task: argparse.Namespace, driver: HeadModel | None, seconds: float | None
) -> dict[str, Motion]:
    """Read motions that the command line names.

    Args:
        texts: FILE or NAME=FILE; the name of a file without suffix is that of its motion.
        task: The command line.
        driver: Head model of the driver.
        seconds: As of `edited_motion`.

    Returns:
        Motions by name.

    Raises:
        SettingsError: If a name appears twice.
    """
    motions = {}
    for text in texts:
        name, equals, file = text.partition("=")
        if not equals or Path(text).exists():
            name, file = Path(text).stem.removesuffix(".arkit"), text
        if name in motions or not name:
            raise SettingsError(f"--motion {text}: two motions have the name {name}; write NAME={file}")
        motions[name] = edited_motion(file, task, driver, seconds)
    return motions


def check_length(seconds: float | None) -> None:
    """Refuse lengths that no motion has.

    Args:
        seconds: Length; None for any.

    Raises:
        SettingsError: If it is out of range.
    """
    if seconds is not None and not 0 < seconds <= MAX_SECONDS:
        raise SettingsError(f"--seconds {seconds:g}: expected up to {MAX_SECONDS:g} of a motion")


def edited(motion: Motion, task: argparse.Namespace, seconds: float | None) -> Motion:
    """Edit a motion as the command line says.

    Args:
        motion: The motion.
        task: The command line.
        seconds: Length to which it is cut or repeated; None for its own.

    Returns:
        The motion.

    Raises:
        SettingsError: If an option is out of range.
    """
    from carigs.motion import editing

    check_length(seconds)
    if task.neutral is not None:
        motion = editing.neutralised(motion, task.neutral)
    motion = editing.trimmed(motion, task.start, task.end)
    if task.smooth:
        motion = editing.smoothed(motion)
    if task.mirror:
        motion = editing.mirrored(motion)
    motion = editing.strengthened(motion, dict(task.strengths))
    return motion if seconds is None else editing.looped(motion, seconds)
