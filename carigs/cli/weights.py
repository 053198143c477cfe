"""`carigs weights`: which network weights there are, and where to get the others."""

from __future__ import annotations

from collections.abc import Sequence

from carigs.cli.options.parser import command_parser
from carigs.errors import InputError, print_line
from carigs.weights.registry import Weights, registry
from carigs.weights.search import find_weights, locate_weights, verify

EXAMPLES = """examples:
  carigs weights list
  carigs weights fetch clip_vit_b32_openai dino_vits16
  carigs weights fetch mediapipe_face
  carigs weights verify --folder /data/weights

Weights are searched in --folder (as metrics.weights), in the folder that the environment variable CARIGS_WEIGHTS
names, in the cache of the Hugging Face hub, and in torch's. A download goes into the first of the two folders that is
set, else into torch's cache. Started again, an interrupted one goes on where it was.
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code: 1 if a file is wrong.
    """
    parser = command_parser(
        "weights",
        "Network weights of the metrics and of the search for faces: list, verify or download them.",
        EXAMPLES,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    several = {
        "list": ("name, size and licence, and the place or the source of each", "*"),
        "verify": ("compare what is there with the known sizes and checksums", "*"),
        "fetch": ("download what is missing, with a checksum that is kept beside it", "+"),
    }
    entries = registry()
    for name, (summary, number) in several.items():
        command = commands.add_parser(name, help=summary, description=summary.capitalize() + ".")
        command.add_argument("names", nargs=number, metavar="NAME", help=f"all if left out: {', '.join(entries)}")
        command.add_argument("--folder", metavar="DIR", help="folder to search first, and to download into")
    parsed = parser.parse_args(arguments)
    if unknown := [name for name in parsed.names if name not in entries]:
        parser.error(f"unknown weights {unknown[0]}; known: {', '.join(entries)}")
    chosen = [entries[name] for name in parsed.names or entries]
    return {"list": _list, "verify": _verify, "fetch": _fetch}[parsed.command](chosen, parsed.folder)


def _list(chosen: Sequence[Weights], folder: str | None) -> int:
    for weights in chosen:
        found = locate_weights(weights, folder)
        size = sum(path.stat().st_size for path in found.files.values()) if found else weights.size
        shown = "size unknown" if size is None else f"{size / 1e6:.0f} MB"
        print(f"{weights.name}: {weights.title}, {shown}, licence {weights.licence}")
        print(f"  {found.path}" if found else f"  missing; from {weights.source}")
    return 0


def _verify(chosen: Sequence[Weights], folder: str | None) -> int:
    wrong = False
    for weights in chosen:
        found = locate_weights(weights, folder)
        if not found:
            print(f"{weights.name}: missing")
        for file, path in found.files.items() if found else ():
            try:
                compared = verify(weights, file, path)
            except InputError as error:
                print_line(str(error))
                wrong = True
            else:
                verdict = f"{compared} agrees" if compared else "there, not compared: no checksum is known"
                print(f"{weights.name}: {path}: {verdict}")
    return int(wrong)


def _fetch(chosen: Sequence[Weights], folder: str | None) -> int:
    for weights in chosen:
        print(f"{weights.name}: {find_weights(weights, folder, download=True)}, licence {weights.licence}")
    return 0
