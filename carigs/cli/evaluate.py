"""`carigs evaluate`: the benchmark card of renderings that any program has made of a study's subject."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.capture import Camera, Capture
from carigs.capture.capture_json import camera_to_json
from carigs.capture.frame_index import level_folder, write_frame_index
from carigs.cli.options.parser import command_parser
from carigs.config import load_settings, project_root
from carigs.errors import InputError, SettingsError
from carigs.settings import STAGES
from carigs.settings.option import Section
from carigs.stages.render import ViewToRender, rendered_views
from carigs.system.files import write_json

if TYPE_CHECKING:
    from evaluation.card.frame_folder import Key

EXAMPLES = """examples:
  carigs evaluate --results results/toy --subject toy --views views.json
      what to render: cameras, timesteps, levels and names of the images
  carigs evaluate --results results/toy --subject toy --frames mine -o mine/card
      card.md and card.json of the images in mine/level=0/test/00027_00.png ...
  carigs evaluate --results results/toy --subject toy --frames mine --name mine --compare alternating -o mine/card
      beside a variant of the study, with differences paired by frame

docs/evaluation.md describes the protocol.
"""
PROTOCOLS = ("test", "val", "orbit")
NO_AVATAR = "renderings of another program: its avatar is not known"


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.

    Raises:
        SettingsError: A name cannot be used, or an option is missing.
        InputError: Renderings are missing, not asked for or of another size, or the study lacks a file.
    """
    options = _parser().parse_args(arguments)
    if not re.fullmatch(r"\w[\w-]*", options.name):
        raise SettingsError(f"--name {options.name}: letters, digits, _ and - only")
    place = options.results / options.subject / f"gamma={options.gamma}"
    capture = Capture.load(options.results / options.subject / "capture.json")
    # Level 0 is always needed: CLIP-C of an edit is compared with that of the unedited frames.
    levels = sorted({"0", *(options.level or _known_levels(place))}, key=float)
    render = _settings(options, "render", f"subject={options.subject},gamma={options.gamma}")
    views = {level: list(rendered_views(render, capture, float(level))) for level in levels}
    if options.views:
        write_json(options.views, [_view_json(level, *view) for level, some in views.items() for view in some])
        print(options.views)
        return 0
    if options.frames is None or options.output is None:
        raise SettingsError("--frames and --output are needed, or --views")
    _evaluate(options, capture, views, place)
    return 0


def _evaluate(
    options: argparse.Namespace, capture: Capture, views: dict[str, list[tuple[ViewToRender, Camera]]], place: Path
) -> None:
    """Measure the frames, and write records, tables and the card."""
    from carigs.stages.metrics import metrics
    from carigs.stages.tabulate import tabulate
    from evaluation.card.card import make_card, write_card
    from evaluation.card.costs import missing_avatar_values
    from evaluation.card.document import write_markdown
    from evaluation.card.frame_folder import Wanted, find_frames
    from evaluation.card.provenance import commit, machine, versions
    from evaluation.metrics.catalogue import CATALOGUE
    from evaluation.tables.summary_file import read_summaries

    wanted = {
        level: [Wanted(v[:3], v.file, (camera.width, camera.height)) for v, camera in some]
        for level, some in views.items()
    }
    found = find_frames(options.frames, wanted, options.protocol)
    frames, written = options.output / "frames", options.output / "metrics.csv"
    _write_indices(frames, views, found)
    metrics(
        _settings(options, "metrics", f"subject={options.subject}"),
        frames=frames,
        capture=options.results / options.subject / "capture.json",
        path=place / "path.npz",
        truths=[place / f"truth/level={level}/truth.json" for level in views],
        study=options.results.resolve().name,
        subject=options.subject,
        variant=options.name,
        seed=options.seed,  # pairs them with the compared variants
        gamma=float(options.gamma),
        levels=[float(level) for level in views],
        embeddings=str(options.output / "embeddings"),
        records=written,
    )
    records = [*(place / variant / f"seed={options.seed}/metrics.csv" for variant in options.compare), written]
    tabulated = _settings(options, "tabulate", "all")
    if tabulated.reference not in options.compare:
        tabulated = replace(tabulated, reference=options.name)
    tables = {suffix: options.output / f"table.{suffix}" for suffix in ("csv", "md", "tex")}
    tabulate(tabulated, records=records, table=tables["csv"], markdown=tables["md"], latex=tables["tex"])
    camera = next(iter(capture.cameras.values()))
    variants = [options.name, *options.compare]
    card = make_card(
        read_summaries(tables["csv"]),
        [value for variant in variants for value in missing_avatar_values(options.subject, variant, NO_AVATAR)],
        tabulated,
        CATALOGUE,
        images={options.subject: [camera.width, camera.height]},
        training_seeds=[],
        seeds={},
        provenance={"machine": machine(), "versions": versions(), "commit": commit(project_root())},
    )
    write_card(options.output / "card.json", card)
    write_markdown(options.output / "card.md", card)
    print(options.output / "card.md")


def _parser() -> argparse.ArgumentParser:
    description = "Measure renderings of a study's subject, by whichever program, and write their benchmark card."
    parser = command_parser("evaluate", description, EXAMPLES)
    parser.add_argument("--results", type=Path, required=True, metavar="FOLDER", help="results of the study")
    parser.add_argument("--subject", required=True, metavar="NAME", help="subject of the study")
    parser.add_argument("--gamma", default="0.25", metavar="G", help="as in the names of folders (default %(default)s)")
    parser.add_argument("--level", action="append", metavar="L", help="a level (default: all of the study)")
    parser.add_argument(
        "--protocol", nargs="+", choices=PROTOCOLS, default=PROTOCOLS, help="frames that are measured (default: all)"
    )
    parser.add_argument("--frames", type=Path, metavar="FOLDER", help="the renderings: a folder per level")
    parser.add_argument("--name", default="submission", metavar="NAME", help="their name in tables")
    parser.add_argument(
        "--compare", action="append", default=[], metavar="VARIANT", help="a variant of the study beside them"
    )
    seed_help = "seed of the compared variants' training (default %(default)s)"
    parser.add_argument("--seed", type=int, default=0, metavar="S", help=seed_help)
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="folder to write")
    parser.add_argument("--views", type=Path, metavar="FILE", help="write what has to be rendered (JSON), and end")
    return parser


def _known_levels(place: Path) -> list[str]:
    """The levels of the study, whose truths are indexed."""
    levels = [file.parent.name.removeprefix("level=") for file in place.glob("truth/level=*/truth.json")]
    if not levels:
        raise InputError("no truth of any level; make the study first", file=place)
    return sorted(levels, key=float)


def _settings(options: argparse.Namespace, stage: str, point: str) -> Section:
    """The settings that the study has used; the defaults if it has none."""
    file = options.results / f"settings/{stage}/{point}.yaml"
    return load_settings(stage, file) if file.is_file() else STAGES[stage]()


def _write_indices(
    folder: Path, views: Mapping[str, list[tuple[ViewToRender, Camera]]], found: Mapping[str, Mapping[Key, Path]]
) -> None:
    """Write for each level what the stage `render` writes beside its images; the images stay where they are."""
    from evaluation.metrics.catalogue import CATALOGUE
    from evaluation.tables.frame_records import FrameRecord, write_frame_records

    unknown = [name for name, metric in CATALOGUE.items() if metric.table == "geometry"]
    for level, some in views.items():
        entries, geometry = [], []
        for view, camera in some:
            if file := found[level].get(view[:3]):
                novel = {"view": camera_to_json(camera)} if view.protocol == "orbit" else {}
                entries.append({**view._asdict(), "file": file.resolve().as_posix(), **novel})
                if view.protocol == "test":
                    key = (view.protocol, view.camera, view.timestep)
                    geometry += [FrameRecord(*key, "full", name, None, NO_AVATAR) for name in unknown]
        write_frame_index(level_folder(folder, float(level)) / "frames.json", entries)
        write_frame_records(level_folder(folder, float(level)) / "geometry.csv", geometry)


def _view_json(level: str, view: ViewToRender, camera: Camera) -> dict[str, object]:
    fields = {"level": float(level), "file": f"level={level}/{view.file}", **view._asdict()}
    return {**fields, "view": camera_to_json(camera)}
