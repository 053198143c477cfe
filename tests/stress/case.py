"""Cases of the stress suites, what became of them, and the command line of a suite.

The outcome of a case is one of

- `right`: every measured number is within its tolerance of a closed form, an independent reference or an invariant;
- `typed error`: the input is invalid, and a `CarigsError` says so;
- `wrong`: everything else, such as a number that is not finite, another exception, or an error for valid input.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool
from numpy.typing import ArrayLike

from carigs.errors import CarigsError
from evaluation.command_line import csv_parser
from evaluation.tables.csv_files import stream_csv

OUTCOMES = ("right", "typed error", "wrong")


class Measure(NamedTuple):
    """A number that must not exceed its tolerance."""

    what: str
    error: float
    tolerance: float = 0.0

    @property
    def holds(self) -> bool:
        """Whether it does not; false for nan."""
        return bool(self.error <= self.tolerance)


class Case(NamedTuple):
    """An input, and what must hold for it."""

    name: str
    measure: Callable[[], Iterable[Measure]]
    """Runs the code under test; at least one number results."""
    invalid: bool = False
    """Whether only a typed error is right."""


class Outcome(NamedTuple):
    """What became of a case."""

    suite: str
    case: str
    outcome: str
    """One of `OUTCOMES`."""
    error: float | None
    """The number that comes closest to its tolerance, or exceeds it most."""
    tolerance: float | None
    detail: str
    """What the number is, or the message of the error."""

    @property
    def holds(self) -> bool:
        """Whether the case is not wrong."""
        return self.outcome != "wrong"


def difference(what: str, found: ArrayLike, expected: ArrayLike, tolerance: float) -> Measure:
    """Compare arrays.

    Args:
        what: Name of the quantity.
        found: Values of the code under test.
        expected: Right values, of the same shape, or one number for all.
        tolerance: Largest admissible difference.

    Returns:
        The largest difference: 0 where both are infinite with the same sign, nan if a single one is not a number.
    """
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    if expected.ndim and found.shape != expected.shape:
        return Measure(f"{what}: shape {found.shape} instead of {expected.shape}", np.inf)
    with np.errstate(invalid="ignore"):
        errors = np.where(found == expected, 0.0, np.abs(found - expected))
    return Measure(what, float(errors.max(initial=0.0)), tolerance)


def violations(what: str, violated: Bool[np.ndarray, "*n"]) -> Measure:
    """Count violations of an invariant, of which there must be none.

    Args:
        what: What a violation is.
        violated: Whether each element violates the invariant.

    Returns:
        Their number, with tolerance 0.
    """
    return Measure(what, float(np.count_nonzero(violated)))


def examine(suite: str, case: Case) -> Outcome:
    """Run a case.

    Args:
        suite: Name of its suite.
        case: The case.

    Returns:
        Its outcome.
    """
    try:
        with np.errstate(all="ignore"):
            measures = list(case.measure())
    except CarigsError as error:
        outcome = "typed error" if case.invalid else "wrong"
        return Outcome(suite, case.name, outcome, None, None, f"{type(error).__name__}: {error}")
    except Exception as error:
        line = " ".join(str(error).split())[:300]
        return Outcome(suite, case.name, "wrong", None, None, f"{type(error).__name__}: {line}")
    if case.invalid or not measures:
        return Outcome(suite, case.name, "wrong", None, None, "no error" if case.invalid else "nothing was measured")
    worst = max(measures, key=_excess)
    return judged(suite, case.name, worst)


def judged(suite: str, case: str, measure: Measure) -> Outcome:
    """Outcome of a case with one measured number.

    Args:
        suite: Name of the suite.
        case: Name of the case.
        measure: The number.

    Returns:
        The outcome.
    """
    outcome = "right" if measure.holds else "wrong"
    return Outcome(suite, case, outcome, float(measure.error), float(measure.tolerance), measure.what)


def _excess(measure: Measure) -> float:
    """Orders measures: the number over its tolerance, infinite if it does not hold for tolerance 0 or nan."""
    if np.isnan(measure.error):
        return np.inf
    if measure.tolerance == 0:
        return np.inf if measure.error > 0 else 0.0
    return measure.error / measure.tolerance


def suite_parser(description: str | None) -> argparse.ArgumentParser:
    """Parser of a suite's command line.

    Args:
        description: Text of `--help`.

    Returns:
        Parser with the arguments `rows` and `keep_going`.
    """
    parser = csv_parser(description or "")
    parser.add_argument(
        "--keep-going", action="store_true", help="exit with status 0 also if a case is wrong: summary.py then fails"
    )
    return parser


def write_outcomes(arguments: argparse.Namespace, outcomes: Iterator[Outcome]) -> list[Outcome]:
    """Run cases, write their outcomes, and print how many have which, and those that are wrong.

    Args:
        arguments: Parsed command line.
        outcomes: Runs the cases.

    Returns:
        The outcomes.
    """
    results = stream_csv(arguments.rows, outcomes, Outcome, digits=3)
    counts = Counter(result.outcome for result in results)
    print(f"{len(results)} cases: " + ", ".join(f"{counts[outcome]} {outcome}" for outcome in OUTCOMES))
    for result in results:
        if not result.holds:
            error = "" if result.error is None else f": {result.error:.3g} > {result.tolerance:.3g}"
            print(f"  {result.case}: {result.detail}{error}")
    return results


def fails(arguments: argparse.Namespace, results: Iterable[Outcome]) -> bool:
    """Whether the program of a suite fails.

    Args:
        arguments: Parsed command line.
        results: Outcomes of all cases.

    Returns:
        True if a case is wrong, unless the program was told to keep going.
    """
    return not arguments.keep_going and not all(result.holds for result in results)


def run_suite(description: str | None, suite: str, cases: Iterable[Case]) -> bool:
    """Run a suite that needs no input from the command line.

    Args:
        description: Text of `--help`.
        suite: Name of the suite.
        cases: Its cases.

    Returns:
        Whether the program fails.
    """
    arguments = suite_parser(description).parse_args()
    return fails(arguments, write_outcomes(arguments, (examine(suite, case) for case in cases)))
