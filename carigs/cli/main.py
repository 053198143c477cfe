"""The command `carigs`: finds the subcommand and hands it its arguments.

A subcommand is a module of this package with `main(arguments) -> exit code`: 0, 1 for an error, 2 for a wrong command
line. It is imported when it is called, so that `carigs --help` starts at once.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.metadata import version

from carigs.errors import print_line, report
from carigs.runs.summary import warnings_as_lines
from carigs.system.cache_folders import find_cache_of_matplotlib
from carigs.system.extras import naming_extras

COMMANDS = {
    "run": "make a study: avatars, table and figures",
    "sweep": "make a study at several values of its settings",
    "plan": "show what a study will cost: jobs, hours, memory, disk",
    "evaluate": "measure anybody's renderings of a study's subject",
    "check": "validate a dataset: what is wrong with it, and how to mend it",
    "landmarks": "find the landmarks of a face in a video or a folder of images",
    "matte": "make frames and mattes of a video or of photographs",
    "track": "make a dataset of a video of one person",
    "fit": "fit a head model to a calibrated video with landmarks",
    "head": "bring a head model in: download or convert it",
    "convert": "read and write avatars, meshes and captures of other programs",
    "motion": "read, edit and write what drives an avatar",
    "export": "write a clip of an avatar, or the avatar as one HTML file",
    "augment": "write labelled renderings of avatars, for training recognisers",
    "view": "show an avatar in the browser, with sliders",
    "mesh": "exaggerate a mesh",
    "weights": "list, verify or download network weights",
    "settings": "show the settings of a study, or the reference of all settings",
}


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; a warning, or an error that is no mistake of the program, is one line on stderr.

    Args:
        arguments: The command line without the program's name; `sys.argv` if None.

    Returns:
        Exit code.
    """
    command, *others = (sys.argv[1:] if arguments is None else arguments) or [""]
    try:
        status = _run(command, others)
        sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        return report(error)
    return status


def _run(command: str, arguments: list[str]) -> int:
    if command in COMMANDS:
        find_cache_of_matplotlib()
        with warnings_as_lines(), naming_extras():
            return import_module(f"carigs.cli.{command}").main(arguments)
    if command == "--version":
        print(f"carigs {version('carigs')}")
    elif command in ("-h", "--help"):
        print(_help())
    else:
        print(_help(), file=sys.stderr)
        print_line(f"unknown command {command}" if command else "no command")
        return 2
    return 0


def _help() -> str:
    commands = "\n".join(f"  {name:11}{summary}" for name, summary in COMMANDS.items())
    return f"""usage: carigs COMMAND ...

Caricature avatars from multi-view captures.

commands:
{commands}

carigs COMMAND --help describes a command; carigs --version prints the version.

example: carigs run study=toy --cores 2"""
