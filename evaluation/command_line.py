"""Command lines of the benchmarks, stress tests and galleries."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from carigs.errors import report


def csv_parser(description: str) -> argparse.ArgumentParser:
    """Parser of a program that writes a CSV file.

    Args:
        description: Text of `--help`; line breaks are kept.

    Returns:
        Parser with the argument `rows`, the file to write.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, help="CSV to write; a plot goes beside it")
    return parser


def run(main: Callable[[], bool | None]) -> NoReturn:
    """Run a program and exit: status 1 if it fails, with errors that are no mistakes of the program in one line.

    Args:
        main: Program; a true result is a failure.
    """
    try:
        sys.exit(int(bool(main())))
    except (Exception, KeyboardInterrupt) as error:
        sys.exit(report(error))
