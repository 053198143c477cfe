"""Damaged and odd captures: the stage capture refuses or warns of damage, and accepts what is only odd.

Each case changes a copy of a sound capture. A damaged one must be refused (`InputError`) or cause a warning; an odd one
must cause neither.

Example:
    PYTHONPATH=tests python -m stress.captures results/stress/captures.csv DATASET HEAD_MODEL.npz
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from carigs.capture import read_dataset
from carigs.errors import CarigsError
from carigs.plausibility import check_capture
from evaluation.command_line import csv_parser, run
from evaluation.tables.csv_files import stream_csv
from stress.capture_changes.cases import Case, cases
from stress.capture_changes.folder import copy_capture


class Outcome(NamedTuple):
    """What happened to a case."""

    case: str
    expected: str
    """`noticed` or `accepted`."""
    outcome: str
    """`refused`, `warned`, `accepted`, or the name of an exception that is no message."""
    seconds: float
    message: str

    @property
    def holds(self) -> bool:
        """Whether the outcome is the expected one."""
        return self.outcome in {"noticed": ("refused", "warned"), "accepted": ("accepted",)}[self.expected]


def examine(case: Case, source: Path, model: Path) -> Outcome:
    """Change a copy of a capture and check it.

    Args:
        case: The change.
        source: The capture.
        model: Its head model.

    Returns:
        What happened.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = copy_capture(source, model, Path(temporary) / "capture")
        case.change(folder)
        start = perf_counter()
        try:
            lines = check_capture(read_dataset(folder.root, folder.model, **folder.options)).warnings
            outcome, message = ("warned", " | ".join(lines)) if lines else ("accepted", "")
        except CarigsError as error:
            outcome, message = "refused", str(error)
        except Exception as error:
            outcome, message = type(error).__name__, repr(error)
        message = message.replace(f"{folder.root}/", "")
    return Outcome(case.name, "noticed" if case.is_damage else "accepted", outcome, perf_counter() - start, message)


def main() -> bool:
    """Run the cases from the command line, and write what happened.

    Returns:
        Whether an outcome is not the expected one.
    """
    parser = csv_parser(__doc__)
    parser.add_argument("capture", type=Path, help="a sound capture in the layout of GaussianAvatars")
    parser.add_argument("model", type=Path, help="its head model (.npz)")
    parser.add_argument("--only", default=".*", help="regular expression for names of cases")
    arguments = parser.parse_args()
    chosen = [case for case in cases() if re.search(arguments.only, case.name)]
    results = stream_csv(
        arguments.rows, (examine(case, arguments.capture, arguments.model) for case in chosen), Outcome, digits=3
    )
    damages = [result for result in results if result.expected == "noticed"]
    print(f"{sum(result.holds for result in damages)} of {len(damages)} damages are noticed")
    odd = [result for result in results if result.expected == "accepted"]
    print(f"{sum(not result.holds for result in odd)} of {len(odd)} oddities raise a false alarm")
    for result in results:
        if not result.holds:
            print(f"  {result.case}: {result.outcome} {result.message[:300]}")
    return not all(result.holds for result in results)


if __name__ == "__main__":
    run(main)
