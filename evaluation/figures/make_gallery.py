"""The pictures of the documents, made again by the commands of docs/images/commands.toml.

Example:
    python -m evaluation.figures.make_gallery docs/images/commands.toml               those whose data are there
    python -m evaluation.figures.make_gallery docs/images/commands.toml hero.webp     these
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from carigs.errors import InputError
from carigs.system.files import writing
from evaluation.command_line import run

WEBP_QUALITY = 90


@dataclass(frozen=True)
class Picture:
    """A picture of the documents; docs/images/commands.toml explains the fields."""

    file: str
    command: str
    made: str = ""
    width: int | None = None
    needs: tuple[str, ...] = ()

    @property
    def lacks(self) -> list[str]:
        """What the command needs and is not there."""
        return [need for need in self.needs if not Path(os.path.expandvars(need)).exists()]


def read_pictures(file: Path) -> list[Picture]:
    """Read the list of pictures.

    Args:
        file: The TOML file.

    Returns:
        The pictures, in the order of the file.

    Raises:
        InputError: If an entry has unknown fields, or no command.
    """
    pictures = []
    for entry in tomllib.loads(file.read_text("utf-8"))["picture"]:
        try:
            pictures.append(Picture(**{**entry, "needs": tuple(entry.get("needs", ()))}))
        except TypeError as error:
            raise InputError(f"a picture is wrong: {error}", file=file) from None
    return pictures


def make_pictures(pictures: Sequence[Picture]) -> bool:
    """Run the commands in the current directory, each once, and print what becomes of each picture.

    Args:
        pictures: What to make. One whose data are not there is left as it is.

    Returns:
        Whether no command failed.
    """
    status: dict[str, bool] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for picture in pictures:
            print(f"{picture.file}: {_make(picture, scratch, status)}", flush=True)
    return all(status.values())


def _make(picture: Picture, scratch: str, status: dict[str, bool]) -> str:
    """Make a picture unless something is missing; `status` says which commands have succeeded."""
    if picture.lacks:
        return f"left as it is; missing: {', '.join(picture.lacks)}"
    names = {"file": picture.file, "scratch": scratch}
    command = _filled(picture.command, names)
    if command not in status:
        status[command] = subprocess.run(["bash", "-euo", "pipefail", "-c", command]).returncode == 0
    if not status[command]:
        return f"not made; failed: {command}"
    if picture.made:
        write_resized(Path(_filled(picture.made, names)), Path(picture.file), picture.width)
    return "made"


def _filled(text: str, names: dict[str, str]) -> str:
    for name, value in names.items():
        text = text.replace(f"{{{name}}}", value)
    return text


def write_resized(source: Path, target: Path, width: int | None) -> None:
    """Write an image in another format, scaled down if it is too wide.

    Args:
        source: The image.
        target: File to write; its suffix is the format.
        width: Largest width in pixels; None for any.
    """
    with Image.open(source) as image:
        if width is not None and image.width > width:
            image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
        with writing(target) as part:
            if target.suffix == ".webp":
                image.convert("RGB").save(part, "WEBP", quality=WEBP_QUALITY)
            else:
                image.save(part, "PNG", optimize=True)


def main() -> bool:
    """Make the pictures.

    Returns:
        Whether a command failed.

    Raises:
        InputError: If no picture has a given name.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("list", type=Path, help="the list of pictures")
    parser.add_argument("names", nargs="*", metavar="NAME", help="names of pictures (default: all)")
    arguments = parser.parse_args()
    pictures = read_pictures(arguments.list)
    names = {Path(picture.file).name for picture in pictures}
    if unknown := sorted({*arguments.names} - names):
        raise InputError(f"no picture is called {unknown[0]}", file=arguments.list)
    os.environ["PATH"] = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    chosen = [picture for picture in pictures if not arguments.names or Path(picture.file).name in arguments.names]
    return not make_pictures(chosen)


if __name__ == "__main__":
    run(main)
