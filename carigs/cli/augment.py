"""`carigs augment`: labelled renderings of avatars at levels of exaggeration, for training recognisers of faces.

OUT gets PERSON/level=LEVEL/POSE.png for every person, level and pose, and labels.csv with person, level, pose, azimuth,
elevation and the timestep of the expression. A pose is the same view and expression at all levels: what differs is the
exaggeration alone.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from pathlib import Path

from rich.progress import track

from carigs.cli.options.parser import command_parser
from carigs.errors import SettingsError

EXAMPLES = """examples:
  carigs augment faces anna=anna.npz berta=berta.npz
  carigs augment faces anna=anna.npz --level 0 --level 0.1 --level 0.25 --poses 40 --azimuth 45 --size 112
"""
LEVELS = (0.0, 0.1, 0.25)
MAX_SIZE, MAX_IMAGES = 4096, 1_000_000


def augment(task: argparse.Namespace) -> None:
    """Render and write the set.

    Args:
        task: The command line.

    Raises:
        InputError: For avatars that cannot be read, and for a folder that exists.
        SettingsError: For values out of range, and for two people of one name.
    """
    levels = list(dict.fromkeys(task.levels or LEVELS))
    people = Counter(name for name, _ in task.avatars)
    if (twice := people.most_common(1)[0])[1] > 1:
        raise SettingsError(f"{twice[0]}: two avatars have this name")
    limits = (("--poses", task.poses, 1, MAX_IMAGES), ("--size", task.size, 16, MAX_SIZE),
              ("--azimuth", task.azimuth, 0, 180), ("--elevation", task.elevation, 0, 80))  # fmt: skip
    for name, value, low, high in limits:
        if not low <= value <= high:
            raise SettingsError(f"{name} {value:g}: expected {low} to {high}")
    if (count := len(people) * len(levels) * task.poses) > MAX_IMAGES:
        raise SettingsError(f"{count} images; at most {MAX_IMAGES} are written")
    from carigs.library import load
    from carigs.library.labelled_set import draw_labels, write_labelled_set

    avatars = {name: load(file) for name, file in task.avatars}
    timesteps = {name: avatar.timesteps for name, avatar in avatars.items()}
    angles = {"azimuth": task.azimuth, "elevation": task.elevation}
    labels = draw_labels(timesteps, levels, task.poses, **angles, seed=task.seed)
    written = write_labelled_set(task.output, avatars, labels, task.size)
    done = sum(1 for _ in track(written, task.output.name, total=len(labels), transient=True))
    print(
        f"{task.output}: {done} images of {len(people)} people at levels {', '.join(f'{level:g}' for level in levels)}"
    )


def _named_avatar(text: str) -> tuple[str, Path]:
    name, equals, file = text.partition("=")
    if not equals or not re.fullmatch(r"[\w-]{1,100}", name) or not file:
        raise argparse.ArgumentTypeError(f"{text}: expected NAME=AVATAR.npz, the name of letters, digits, _ and -")
    return name, Path(file)


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("augment", __doc__.partition("\n\n")[2], EXAMPLES)
    parser.add_argument("output", type=Path, metavar="OUT", help="folder to create")
    parser.add_argument("avatars", type=_named_avatar, nargs="+", metavar="NAME=AVATAR", help="a person and its avatar")
    parser.add_argument(
        "--level", type=float, action="append", dest="levels", help="exaggeration; repeat it (default: 0, 0.1, 0.25)"
    )
    parser.add_argument("--poses", type=int, default=20, help="views and expressions of each person (default: 20)")
    parser.add_argument(
        "--azimuth", type=float, default=60.0, help="largest angle to either side (default: 60 degrees)"
    )
    parser.add_argument("--elevation", type=float, default=15.0, help="the same up and down (default: 15 degrees)")
    parser.add_argument("--size", type=int, default=224, help="height and width of the images (default: 224 pixels)")
    parser.add_argument("--seed", type=int, default=0, help="seed of views and expressions (default: 0)")
    augment(parser.parse_args(arguments))
    return 0
