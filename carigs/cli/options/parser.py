"""Parsers of the subcommands' options."""

from __future__ import annotations

import argparse
import math
from pathlib import Path


def command_parser(command: str, description: str, examples: str) -> argparse.ArgumentParser:
    """Start the parser of a subcommand.

    Args:
        command: Name of the subcommand.
        description: What it does.
        examples: Shown after the options.

    Returns:
        A parser without options, whose help keeps the line breaks of both texts.
    """
    return argparse.ArgumentParser(
        f"carigs {command}",
        description=description,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def region_level(text: str) -> tuple[str, float]:
    """Parse NAME=LEVEL, the type of options such as `--region`.

    Args:
        text: The text.

    Returns:
        Name and level.

    Raises:
        argparse.ArgumentTypeError: If it is something else.
    """
    name, _, level = text.partition("=")
    try:
        value = float(level)
    except ValueError:
        value = math.nan
    if not name or not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text}: expected NAME=LEVEL, as nose=0.4")
    return name, value


def add_capture_options(parser: argparse.ArgumentParser) -> None:
    """Add what subcommands that read a capture in another form have in common.

    Args:
        parser: Receives `cameras`, `metres_per_unit`, `background` and `copy`.
    """
    parser.add_argument("--cameras", type=Path, metavar="PATH", help="cameras.json or a COLMAP model elsewhere")
    parser.add_argument(
        "--metres-per-unit", type=float, default=1.0, metavar="M", help="0.001 for millimetres (default %(default)s)"
    )
    parser.add_argument(
        "--background",
        type=grey_value,
        default=1.0,
        metavar="GREY",
        help="behind the head (default %(default)s: white)",
    )
    parser.add_argument("--copy", action="store_true", help="copy the images; otherwise they stay where they are")


def study_parser(command: str, description: str, examples: str, usage: str) -> argparse.ArgumentParser:
    """Start the parser of a subcommand that composes a study.

    Args:
        command: Name of the subcommand.
        description: What it does.
        examples: Shown after the options.
        usage: The options as the usage shows them after the overrides.

    Returns:
        A parser with the positional arguments `overrides`. Options may stand between them, so that a command line is
        parsed by `parse_intermixed_args`.
    """
    parser = command_parser(command, description, examples)
    parser.usage = f"carigs {command} [KEY=VALUE ...] {usage}"
    overrides_help = "Hydra overrides KEY=VALUE; docs/configuration.md lists the keys"
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help=overrides_help)
    return parser


def grey_value(text: str) -> float:
    """Parse a grey value, the type of options such as `--background`.

    Args:
        text: The text.

    Returns:
        A value from 0 to 1.

    Raises:
        argparse.ArgumentTypeError: If it is something else.
    """
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text}: expected a value from 0 to 1")
    return value
