"""Values of text on the command line: what follows `=` is the text as it stands.

Hydra's grammar gives `=`, `#`, `~`, `(`, quotes and letters beyond ASCII a meaning, or none, so that it refuses many
names of files, and reads `1e5` and `007` as numbers. Which keys hold text is known from the types of the settings:
their values are quoted here before Hydra reads them. A comma still separates the values of a sweep, `null` is no value,
and `${` starts an interpolation.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping
from functools import cache
from types import UnionType
from typing import get_args, get_type_hints

from hydra.core.override_parser.overrides_parser import create_functions
from hydra.core.override_parser.types import Quote, QuotedString
from omegaconf import OmegaConf
from omegaconf.errors import GrammarParseError

from carigs.errors import SettingsError
from carigs.settings import Config
from carigs.settings.option import keys

_QUOTED = r"""(?:'(?:\\.|[^'\\])*'|"(?:\\.|[^"\\])*")"""
_ELEMENT = re.compile(rf"\s*{_QUOTED}\s*(?=,|\Z)|(?:\$\{{[^}}]*\}}|[^,])*", re.DOTALL)
"""A value in quotes, or all up to the next comma outside of an interpolation."""
_LIST = rf"\[(?:{_QUOTED}|[^\[\]])*\]"
_LISTS = re.compile(rf"\s*{_LIST}(?:\s*,\s*{_LIST})*\s*", re.DOTALL)
_CALL = re.compile(rf"\s*(?:{'|'.join(create_functions().functions)})\s*\(.*\)\s*", re.DOTALL)
"""Hydra's functions, such as `choice(a,b)`."""


TEXT, TEXTS = "a text", "a list of texts, [a,b]"
_KINDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: TEXT,
    tuple[int, ...]: "a list of whole numbers, [0,1]",
    tuple[float, ...]: "a list of numbers, [0.1,0.2]",
    tuple[str, ...]: TEXTS,
    dict[str, float]: "names with numbers, {nose:0.4}",
}


@cache
def kinds_of_values() -> Mapping[str, str]:
    """What each key holds, in words.

    Returns:
        By key what `_KINDS` has for its type; a key that may be null counts as one that may not.
    """
    hints = {key: get_type_hints(section)[f.name] for key, section, f in keys(Config)}
    return {key: _KINDS[get_args(hint)[0] if isinstance(hint, UnionType) else hint] for key, hint in hints.items()}


def quote_text(override: str) -> str:
    """Quote the value of an override whose key holds text, or a list of texts, so that Hydra takes it as it stands.

    Args:
        override: `KEY=VALUE` as a user types it. A value that is quoted already, `null`, and a function of Hydra's
            grammar such as `choice(a,b)` stay as they are.

    Returns:
        The override in Hydra's grammar; of another key the override itself.

    Raises:
        SettingsError: For an open quote, and for an open interpolation.
    """
    key, _, value = override.partition("=")
    kind = kinds_of_values().get(key)
    if kind == TEXT and not _CALL.fullmatch(value):
        return f"{key}={','.join(_quoted_elements(value, override))}"
    if kind == TEXTS and _LISTS.fullmatch(value):
        texts = (f"[{','.join(_quoted_elements(text[1:-1], override, strip=True))}]" for text in _lists(value))
        return f"{key}={','.join(texts)}"
    return override


def with_quotes(text: str) -> str:
    """A text in Hydra's quotes.

    Args:
        text: Any text.

    Returns:
        `'text'`, with the escapes that Hydra needs.
    """
    return QuotedString(text=text, quote=Quote.single).with_quotes()


def quoting_advice(override: str) -> str:
    """How an override is typed whose value is one text.

    Args:
        override: `KEY=VALUE`, of which the whole value is meant as it stands.

    Returns:
        The advice with the word for a shell.
    """
    key, _, value = override.partition("=")
    if not override.isprintable():  # the line would show escapes
        return "quote the value"
    return f"quote the value: {_shell_word(f'{key}={with_quotes(value)}')}"


def _shell_word(text: str) -> str:
    """A word as a user types it in a shell: in double quotes where they protect it."""
    return shlex.quote(text) if re.search(r'["$`\\!]', text) else f'"{text}"'


def _lists(value: str) -> Iterator[str]:
    return (found[0] for found in re.finditer(_LIST, value, re.DOTALL))


def _quoted_elements(value: str, override: str, *, strip: bool = False) -> Iterator[str]:
    """The elements of a value, each in quotes."""
    position = 0
    while not (strip and not value.strip()):
        element = _ELEMENT.match(value, position)[0]
        position += len(element) + 1
        yield _quoted(element.strip() if strip else element, override)
        if position > len(value):
            break


def _quoted(text: str, override: str) -> str:
    bare = text.strip()
    if re.fullmatch(_QUOTED, bare, re.DOTALL) or bare.lower() == "null":
        return bare
    if bare.startswith(("'", '"')):
        raise SettingsError(f"{override}: the quote at the start of the value has no end; {quoting_advice(override)}")
    try:
        OmegaConf.create([text])
    except GrammarParseError as error:
        escaped = override.replace("${", r"\${")
        raise SettingsError(
            f"{override}: `${{` starts an interpolation, and this one is broken; type a backslash before it: "
            f"{_shell_word(escaped)}"
        ) from error
    return with_quotes(text)
