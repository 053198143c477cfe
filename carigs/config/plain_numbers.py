"""Numbers in settings are decimal: whatever programs and people read differently is refused.

YAML 1.1, which OmegaConf reads, takes `010` for 8 and `20:30` for 1230 (minutes and seconds); Hydra's grammar takes
them for texts, which become 10 and an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from hydra.core.override_parser.types import ChoiceSweep, Override

from carigs.config.text_values import TEXT, TEXTS, kinds_of_values

_NUMBER = re.compile(r"[-+]?\.?\d.*", re.DOTALL)
"""What begins as a number does."""
_DIGITS = "[0-9](_?[0-9])*"
_DECIMAL = re.compile(rf"[-+]?(0|(?!0){_DIGITS}|({_DIGITS})?\.({_DIGITS})?([eE][-+]?[0-9]+)?|{_DIGITS}[eE][-+]?[0-9]+)")
"""Everyone reads these alike; a zero in front makes a whole number octal in YAML."""


def is_ambiguous(text: str) -> bool:
    """Whether a text without quotes begins like a number but is not plainly decimal.

    Args:
        text: The value in a file or on the command line.

    Returns:
        Whether it is one such as `010`, `0x1F`, `20:30` or `1__0`.
    """
    return bool(_NUMBER.fullmatch(text)) and not _DECIMAL.fullmatch(text)


def ambiguous_number(override: Override) -> str | None:
    """Find a number of an override that is not plainly decimal.

    Args:
        override: As Hydra parses it.

    Returns:
        The first such value, without quotes, of a key that holds numbers; None if there is none.
    """
    kind = kinds_of_values().get(override.get_key_element())
    if kind in (None, TEXT, TEXTS):
        return None
    return next(filter(is_ambiguous, _bare_texts(override._value)), None)  # value() removes the quotes


def _bare_texts(value: Any) -> Iterator[str]:
    """Texts without quotes in a value, which Hydra's grammar takes for no number."""
    if isinstance(value, ChoiceSweep):
        value = value.list
    elif isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, str):
        yield value
    for element in value if isinstance(value, list) else ():
        yield from _bare_texts(element)
