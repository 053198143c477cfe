"""`carigs head`: bring a head model in."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TypeVar

from carigs.cli.options.parser import command_parser
from carigs.detection.mesh_indices import COUNT
from carigs.errors import InputError, MeshError
from carigs.system.files import writing

Item = TypeVar("Item")
EXAMPLES = """examples:
  carigs head fetch gnm -o gnm_head.npz
  carigs head fetch ict -o ict_head.npz
  carigs head convert-ict ICT-FaceKit/FaceXModel -o ict_head.npz
  carigs head embed my_head.npz -o my_head_mediapipe.npz
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    description = (
        "Bring a head model in: download GNM Head or ICT-FaceKit Light, convert the folder of ICT-FaceKit Light, or "
        "find where the landmarks of MediaPipe lie on a model."
    )
    parser = command_parser("head", description, EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    fetch = commands.add_parser("fetch", help="download a model whose licence allows it (gnm: Apache-2.0; ict: MIT)")
    fetch.add_argument("model", choices=("gnm", "ict"))
    convert = commands.add_parser("convert-ict", help="convert ICT-FaceKit Light")
    convert.add_argument("folder", type=Path, metavar="FACEKIT_DIR", help="its folder FaceXModel")
    for command in (fetch, convert):
        command.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="head model (.npz)")
    embed = commands.add_parser("embed", help="find where the 478 landmarks of MediaPipe lie on a model")
    embed.add_argument("model", type=Path, metavar="MODEL", help="head model: .npz, or FLAME's .pkl")
    embed.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="embedding (default: MODEL_mediapipe.npz beside the model)"
    )
    parsed = parser.parse_args(arguments)
    return {"fetch": _fetch, "convert-ict": _convert, "embed": _embed}[parsed.command](parsed)


def _fetch(parsed: Namespace) -> int:
    from carigs.head.download import FACEKIT, GNM, fetch_head, fetch_ict_facekit

    if parsed.model == "gnm":
        source, digest = GNM, fetch_head(GNM.url, parsed.output)
    else:
        source, digest = FACEKIT, fetch_ict_facekit(parsed.output, partial(_track, doing="downloading"))
    print(f"{source.title}, licence {source.licence}")
    print(f"{parsed.output}  sha256 {digest}")
    return 0


def _convert(parsed: Namespace) -> int:
    from carigs.head.ict_facekit import read_ict_facekit

    model = read_ict_facekit(parsed.folder, _track)
    with writing(parsed.output) as part:
        model.save(part)
    counts = f"{len(model.v_template)} vertices, {model.num_identity} identities, {model.num_expressions} expressions"
    print(f"{parsed.output}  {counts}")
    return 0


def _embed(parsed: Namespace) -> int:
    from carigs.embedding import REGISTRATION, landmark_embedding
    from carigs.head import HeadModel

    model = HeadModel.load(parsed.model)
    try:
        embedding = landmark_embedding(model)
    except MeshError as error:
        raise InputError(str(error), file=parsed.model) from error
    output = parsed.output or parsed.model.with_name(f"{parsed.model.stem}_mediapipe.npz")
    embedding.save(output)
    found = "registered" if embedding.source == REGISTRATION else f"from carigs' file {embedding.source}"
    missing = embedding.missing
    left_out = f"; left out: {', '.join(map(str, missing))}" if missing.size else ""
    print(f"{output}  {len(embedding.landmarks)} of {COUNT} landmarks, {found}{left_out}")
    return 0


def _track(files: Iterable[Item], doing: str = "reading") -> Iterable[Item]:
    from rich.console import Console
    from rich.progress import track

    return track(files, doing, console=Console(stderr=True), transient=True)
