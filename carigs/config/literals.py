"""Values that OmegaConf takes as they stand: a text that holds `${` is no interpolation."""

from __future__ import annotations

import re
from typing import Any


def literal(value: Any) -> Any:
    """Escape the interpolations in the texts of a value.

    Args:
        value: A text, anything else, or mappings and sequences of these.

    Returns:
        The value with a backslash before each `${`, and those before it doubled: OmegaConf gives back the value itself.
    """
    if isinstance(value, str):
        return re.sub(r"(\\*)\$\{", lambda found: 2 * found[1] + r"\${", value)
    if isinstance(value, dict):
        return {key: literal(element) for key, element in value.items()}
    return [literal(element) for element in value] if isinstance(value, list) else value
