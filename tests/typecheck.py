"""What checks array shapes while the tests run; other hints are left alone, so that tests may pass stand-ins."""

from __future__ import annotations

from typing import Any, get_type_hints

from beartype import beartype
from jaxtyping import AbstractArray


def typecheck(function):
    """The function with the shapes of its array arguments and of its result checked by beartype."""
    if isinstance(function, type):
        return function
    hints = {**function.__annotations__, **_resolved(function)}
    function.__annotations__ = {name: hint if _is_array(hint) else Any for name, hint in hints.items()}
    return beartype(function)


def _resolved(function) -> dict[str, Any]:
    try:
        return get_type_hints(function)
    except NameError:  # a name that only type checkers import
        return {}


def _is_array(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, AbstractArray)
