"""`carigs head`: bring a head model in."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from carigs.cli.parser import command_parser
from carigs.system.files import writing

EXAMPLES = """examples:
  carigs head fetch gnm -o gnm_head.npz
  carigs head convert-ict ICT-FaceKit/FaceXModel -o ict_head.npz
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    description = "Bring a head model in: download GNM Head, or convert the folder of ICT-FaceKit Light."
    parser = command_parser("head", description, EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    fetch = commands.add_parser("fetch", help="download a model whose licence allows it (gnm: Apache-2.0)")
    fetch.add_argument("model", choices=("gnm",))
    convert = commands.add_parser("convert-ict", help="convert ICT-FaceKit Light")
    convert.add_argument("folder", type=Path, metavar="FACEKIT_DIR", help="its folder FaceXModel")
    for command in (fetch, convert):
        command.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="head model (.npz)")
    parsed = parser.parse_args(arguments)
    if parsed.command == "fetch":
        from carigs.head.download import GNM_URL, fetch_head

        digest = fetch_head(GNM_URL, parsed.output)
        print(f"{parsed.output}  sha256 {digest}")
    else:
        from carigs.head.ict_facekit import read_ict_facekit

        model = read_ict_facekit(parsed.folder, _track)
        with writing(parsed.output) as part:
            model.save(part)
        counts = (
            f"{len(model.v_template)} vertices, {model.num_identity} identities, {model.num_expressions} expressions"
        )
        print(f"{parsed.output}  {counts}")
    return 0


def _track(files: Iterable[Path]) -> Iterable[Path]:
    from rich.console import Console
    from rich.progress import track

    return track(files, "reading", console=Console(stderr=True), transient=True)
