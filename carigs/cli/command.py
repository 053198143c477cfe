"""How subcommands of `carigs` end."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps

from carigs.errors import CarigsError


def one_line_errors(main: Callable[[list[str]], int]) -> Callable[[list[str]], int]:
    """Turn errors of the input or the settings into one line on stderr.

    Args:
        main: A subcommand: arguments in, exit code out.

    Returns:
        The same with exit code 1 for a `CarigsError`.
    """

    @wraps(main)
    def wrapped(arguments: list[str]) -> int:
        try:
            return main(arguments)
        except CarigsError as error:
            print(f"carigs: {error}", file=sys.stderr)
            return 1

    return wrapped
