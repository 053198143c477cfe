"""GT* frames by a program of the user: it gets frames, mattes and cameras in a folder, and writes edited frames there.

The program and its arguments come from the settings alone; no shell reads them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from carigs.capture import Capture, Frame
from carigs.errors import InputError, SettingsError
from carigs.exaggeration import Caricature
from carigs.gtstar.exchange import EDITED, frames_to_edit, write_exchange
from carigs.settings import Gtstar

POLL_SECONDS = 0.05
"""Between two looks whether the program has ended, at first; up to a second later."""
LAST_BYTES = 4000
"""Of the program's output that are searched for its last line."""


def edit_by_command(
    settings: Gtstar, capture: Capture, exaggerated: Caricature, folder: Path, level: float | None = None
) -> Path:
    """Have the program edit the training frames that an earlier run has not edited.

    Args:
        settings: Settings of the stage.
        capture: The capture.
        exaggerated: The caricature of the level.
        folder: The exchange folder, which is kept where the program fails or is killed.
        level: The level, for the program; None if it is not known.

    Returns:
        Folder of the edited frames, as for the provider `precomputed`. Frames that the program left out are not there.

    Raises:
        SettingsError: There is no such program.
        InputError: The program cannot be started, fails, or makes no new frame for `command_timeout`.
    """
    program, frames = find_program(settings.command), capture.split("train")
    missing = frames_to_edit(folder, capture, frames)
    if len(missing) < len(frames):
        print(f"GT*: {len(frames) - len(missing)} of {len(frames)} frames were edited by an earlier run")
    if missing:
        write_exchange(folder, capture, exaggerated, level, missing)
        _run([program, *settings.command[1:], str(folder.absolute())], folder, settings.command_timeout)
        for frame in frames_left_out(folder, missing):
            reason = "the program has ended without an edited image of it"
            (folder / EDITED / f"{frame}.txt").write_text(f"{reason}\n", encoding="utf-8")
    return folder / EDITED


def find_program(command: Sequence[str]) -> str:
    """Find the program of a command.

    Args:
        command: The program and its arguments.

    Returns:
        Path of the program.

    Raises:
        SettingsError: There is no such program, or it cannot be executed.
    """
    if any("\0" in word for word in command):
        raise SettingsError("gtstar.command: a word has a NUL character, which no program can get")
    if found := shutil.which(command[0]):
        return found
    problem = "cannot be executed" if os.path.isfile(command[0]) else "there is no such program"
    raise SettingsError(f"gtstar.command={command[0][:100]}: {problem}; name one on the PATH, or its path")


def frames_left_out(folder: Path, frames: Sequence[Frame]) -> list[str]:
    """Names of frames of which a program has written neither an image nor a reason.

    Args:
        folder: The exchange folder.
        frames: The frames that it was to edit.

    Returns:
        Their names.
    """
    edited = folder / EDITED
    names = [frame.name for frame in frames]
    return [name for name in names if not any((edited / f"{name}{end}").is_file() for end in (".png", ".txt"))]


def _run(command: list[str], folder: Path, timeout: float) -> None:
    """Run the program until it ends; end it where no new file appears in time."""
    output = folder / "output.txt"
    with output.open("wb") as stream:
        try:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT)
        except (OSError, ValueError) as error:
            raise InputError(f"cannot be started ({error})", file=command[0], field="gtstar.command") from error
        try:
            code = _wait(process, folder / EDITED, timeout)
        finally:
            _end(process)
    if code is None:
        made = len(list((folder / EDITED).glob("*.png")))
        problem = f"no new frame in {timeout:g} s, after {made} frames: it was ended"
        raise InputError(
            problem, file=command[0], field="gtstar.command", remedy="raise gtstar.command_timeout if it needs more"
        )
    if code:
        ended = f"ended with exit code {code}" if code > 0 else f"was ended by signal {-code}"
        raise InputError(f"{ended}; its last line: {_last_line(output)}", file=command[0], field="gtstar.command")


def _wait(process: subprocess.Popen, edited: Path, timeout: float) -> int | None:
    """The exit code; None where no new file has appeared in the folder for too long."""
    changed, known, pause = time.monotonic(), -1, POLL_SECONDS
    while True:
        try:
            return process.wait(pause)
        except subprocess.TimeoutExpired:
            pause = min(1.0, 1.2 * pause, timeout)
        count, now = len(os.listdir(edited)), time.monotonic()
        if count != known:
            known, changed = count, now
        elif now - changed > timeout:
            return None


def _end(process: subprocess.Popen) -> None:
    """End a program that still runs, and what it has started."""
    if process.poll() is not None:
        return
    try:
        started = psutil.Process(process.pid).children(recursive=True)
    except psutil.Error:
        started = []
    for one in (process, *started):
        try:
            one.kill()
        except (psutil.Error, OSError):  # it has ended meanwhile
            continue
    process.wait()


def _last_line(output: Path) -> str:
    content = output.read_bytes()[-LAST_BYTES:].decode("utf-8", "replace")
    lines = [line.strip() for line in content.splitlines() if line.strip()]
    return lines[-1][:300] if lines else "(it printed nothing)"
