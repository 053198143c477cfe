"""Parsers of the subcommands' options."""

from __future__ import annotations

import argparse


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
