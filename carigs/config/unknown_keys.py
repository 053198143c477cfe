"""Keys that are none: what replaces one of an earlier version, and which key a misspelt one is near to."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache

from carigs.settings import Config
from carigs.settings.option import copies, keys
from carigs.settings.removed import REMOVED


def replacement(key: str) -> str:
    """What replaces a key that users could set in earlier versions, or that another key sets.

    Args:
        key: The key.

    Returns:
        The advice; empty for every other key.
    """
    if key in REMOVED:
        return REMOVED[key]
    for field, source in copies(Config):
        if key == field or key.startswith(f"{field}."):
            return f"has the value of {source}{key.removeprefix(field)}; set that"
    return ""


def no_such_setting(key: str) -> str:
    """What is wrong with an unknown key, and which keys may be meant.

    Args:
        key: The key.

    Returns:
        One line.
    """
    if near := _nearest(key):
        return f"{key}: no such setting; did you mean {' or '.join(near)}?"
    return f"{key}: no such setting; docs/configuration.md lists all"


def _nearest(key: str) -> list[str]:
    """Keys that are spelt nearly alike: in the section that the key names, else anywhere."""
    section, _, name = key.rpartition(".")
    known = _names_by_section()
    for sections in ([section] if section in known else [], known):
        names = {name for of_section in sections for name in known[of_section]}
        if near := get_close_matches(name, names, n=1, cutoff=0.7):
            return sorted(f"{s}.{near[0]}".lstrip(".") for s in sections if near[0] in known[s])[:3]
    return get_close_matches(key, [f"{s}.{name}".lstrip(".") for s in known for name in known[s]], n=1, cutoff=0.75)


@cache
def _names_by_section() -> Mapping[str, frozenset[str]]:
    """Names of the keys of each section, and of its subsections."""
    names: dict[str, set[str]] = {}
    for key, _, _ in keys(Config):
        while key:
            section, _, name = key.rpartition(".")
            names.setdefault(section, set()).add(name)
            key = section
    return {section: frozenset(of_section) for section, of_section in names.items()}
