"""`carigs sweep`: make a study at every combination of values."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import islice, product
from math import prod

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from carigs.cli.run import make_study, parse_run, run_parser
from carigs.config import compose_study
from carigs.errors import SettingsError

EXAMPLES = """examples:
  carigs sweep gamma=0.1,0.15,0.2,0.25
  carigs sweep gamma=0.1,0.25 train.num_gtstar_levels=1,4 --cores 2       four runs
"""
MAX_POINTS = 10_000


def sweep_points(overrides: Sequence[str]) -> list[list[str]]:
    """The overrides of every combination of values.

    Args:
        overrides: Hydra overrides, some with several values: `gamma=0.1,0.2` or `seed=range(3)`.

    Returns:
        Lists of overrides with one value each; the last key changes fastest.

    Raises:
        SettingsError: For an override that Hydra cannot parse, and for more than `MAX_POINTS` combinations.
    """
    values = [_values(override) for override in overrides]
    if prod(map(len, values)) > MAX_POINTS:
        raise SettingsError(f"a sweep has at most {MAX_POINTS} combinations of values")
    return [list(point) for point in product(*values)]


def _values(text: str) -> list[str]:
    """The overrides with one value each of an override that may have several."""
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException as error:
        raise SettingsError(f"{text}: {str(error).splitlines()[0]}") from error
    if not override.is_sweep_override():
        return [text]
    values = islice(override.sweep_string_iterator(), MAX_POINTS + 1)
    return [f"{override.get_key_element()}={value}" for value in values]


def main(arguments: list[str]) -> int:
    """Run the subcommand; a combination that fails does not stop the others.

    Args:
        arguments: Its command line.

    Returns:
        Exit code: 1 if a combination failed.
    """
    parser = run_parser("sweep", "Make a study at every combination of comma-separated values, in turn.", EXAMPLES)
    options = parse_run(parser, arguments)
    points = sweep_points(options.overrides)
    for point in points:
        compose_study(*point)
    failed = [" ".join(point) for point in points if not make_study(point, options)]
    if failed:
        print(f"carigs: failed: {'; '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0
