"""Hydra overrides: their line on the command line, how they are parsed, and which are refused before."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import yaml
from antlr4.error.Errors import RecognitionException
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException

from carigs.config.conf_files import choices
from carigs.config.folders import GROUPS, is_choice
from carigs.config.plain_numbers import ambiguous_number
from carigs.config.text_values import TEXT, TEXTS, kinds_of_values, quote_text, quoting_advice
from carigs.config.unknown_keys import replacement
from carigs.errors import SettingsError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text
from carigs.system.files import writing

MAX_LINE_BYTES = 15_000
"""Of a line of overrides: Linux allows 131072 bytes for the command of a job, in which two lines are quoted twice."""
OVERRIDES_FOLDER = Path("results/.overrides")
"""Folder of longer lines; no study has a name that starts with a point."""
MAX_OVERRIDE = 10_000
"""Longest override in characters."""
MAX_BRACKETS = 32
"""Most opening brackets of an override: the time of Hydra's parser grows quickly with their depth."""


def split_overrides(text: str, key: str = "hydra") -> tuple[str, ...]:
    """Split a line of overrides on blanks, with the quotes of a shell; `@FILE` stands for the text of a file.

    Args:
        text: The value of Snakemake's `--config hydra=` or `sweep=`.
        key: Which of them.

    Returns:
        The overrides.

    Raises:
        SettingsError: For an open quote, and for a line that is too long for the commands of jobs.
        InputError: For a file that cannot be read.
    """
    if text.startswith("@"):
        text = decode_text(read_bytes(Path(text[1:]), MAX_TEXT_BYTES, "file of overrides"), text[1:])
    elif (length := len(text.encode())) > MAX_LINE_BYTES:
        problem = f"{key} has {length} bytes, more than {MAX_LINE_BYTES}"
        raise SettingsError(f"{problem}; write it to a file, and type {key}=@FILE")
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        reason = "Snakemake removes a quote at the end of the value; type a blank after it"
        example = f"\"{key}=metrics.edit_prompt='A nose' \""
        raise SettingsError(f"{key}={text}: {error}. {reason}, as in --config {example}") from error


def snakemake_config(overrides: Iterable[str], swept: Iterable[str] = ()) -> list[str]:
    """The values of Snakemake's `--config` for a run.

    Args:
        overrides: Hydra overrides.
        swept: Hydra overrides with several values, if the run is a sweep.

    Returns:
        `hydra=...`, and `sweep=...` of a sweep. A line that is too long for the commands of jobs is written to a file
        in `results/.overrides`, and its name follows: `hydra=@FILE`.
    """
    lines = {"hydra": join_overrides(overrides), "sweep": join_overrides(swept)}
    return [f"{key}={_on_command_line(line)}" for key, line in lines.items() if line or key == "hydra"]


def _on_command_line(line: str) -> str:
    """The line as a text in YAML, as which Snakemake reads a value; blanks, because it removes quotes at the ends."""
    content = line.encode()
    if len(content) <= MAX_LINE_BYTES:
        quoted = yaml.safe_dump(line, default_style='"', width=float("inf"), allow_unicode=True).rstrip("\n")
        return f" {quoted} " if line else ""
    file = OVERRIDES_FOLDER / f"{sha256(content).hexdigest()[:16]}.txt"
    with writing(file) as part:
        part.write_bytes(content)
    return f"@{file.as_posix()}"


def join_overrides(overrides: Iterable[str]) -> str:
    """Join overrides to a line.

    Args:
        overrides: Hydra overrides.

    Returns:
        The line that `split_overrides` splits again.
    """
    return shlex.join(overrides)


@lru_cache(maxsize=4096)
def parse_override(override: str) -> Override:
    """Parse an override; the value of a key that holds text is taken as it stands (`carigs.config.text_values`).

    Args:
        override: `KEY=VALUE` as a user types it.

    Returns:
        What Hydra's parser reads; its `input_line` is the override in Hydra's grammar.

    Raises:
        SettingsError: As for `check_overrides`, for an override that Hydra cannot parse, for a number such as `010`,
            and for the choice of a file that is hidden or out of its group.
    """
    check_overrides((override,))
    if not re.match(r"[^=\s]+=|~", override):
        raise SettingsError(f"{_shown(override)}: expected KEY=VALUE".removeprefix(": "))
    try:
        parsed = OverridesParser.create().parse_override(quote_text(override))
    except (HydraException, RecognitionException, ValueError, RecursionError) as error:
        raise SettingsError(f"{_shown(override)}: {_advice(override, error)}") from error
    if (number := ambiguous_number(parsed)) is not None:
        raise SettingsError(f"{_shown(override)}: {number} can be read in two ways; write it in decimal digits")
    if parsed.key_or_group in GROUPS and not is_choice(str(parsed.value())):
        raise SettingsError(f"{_shown(override)}: {_no_choice(parsed.key_or_group)}")
    return parsed


def parse_single(override: str) -> Override:
    """Parse an override with one value.

    Args:
        override: `KEY=VALUE` as a user types it.

    Returns:
        As `parse_override`.

    Raises:
        SettingsError: As for `parse_override`, and for several values.
    """
    parsed = parse_override(override)
    if parsed.is_sweep_override():
        is_text = kinds_of_values().get(parsed.get_key_element()) == TEXT
        advice = f"; for one value {quoting_advice(override)}" if is_text else ""
        raise SettingsError(f"{_shown(override)}: several values; `carigs sweep` makes a study of each{advice}")
    return parsed


def _advice(override: str, error: Exception) -> str:
    """What is expected instead of an override that Hydra cannot parse; its parser speaks of tokens."""
    key = override.partition("=")[0]
    kind = kinds_of_values().get(key)
    if key in GROUPS:
        return _no_choice(key)
    if kind is None:
        return "no such key with such a value; docs/configuration.md lists the keys"
    if isinstance(error, ValueError):  # of a number of thousands of digits
        return str(error)
    in_quotes = "; in quotes where a text has other characters than letters, digits and _-: ['a b','c']"
    return f"expected {kind}{in_quotes if kind == TEXTS else ''}"


def _no_choice(group: str) -> str:
    return f"there is no {group} of this name; known: {choices(group)}"


def _shown(override: str) -> str:
    return f"{override[:200]}{'...' * (len(override) > 200)}"


def check_overrides(overrides: tuple[str, ...]) -> None:
    """Refuse overrides that Hydra's parser cannot take in reasonable time, and those of Hydra itself.

    Args:
        overrides: Hydra overrides.

    Raises:
        SettingsError: For the first such override.
    """
    for override in overrides:
        shown = f"{override[:60]}{'...' * (len(override) > 60)}"
        if len(override) > MAX_OVERRIDE:
            raise SettingsError(f"{shown}: {len(override)} characters; at most {MAX_OVERRIDE} are read")
        if sum(override.count(bracket) for bracket in "([{") > MAX_BRACKETS:
            raise SettingsError(f"{shown}: more than {MAX_BRACKETS} brackets")
        if re.match(r"[+~\s]*hydra\b", override):  # such as a search path that imports a package
            raise SettingsError(f"{shown}: settings of Hydra itself cannot be changed")


def check_study_overrides(overrides: tuple[str, ...]) -> None:
    """Refuse overrides that a study cannot have, because it sets the keys itself.

    Args:
        overrides: Hydra overrides.

    Raises:
        SettingsError: For overrides of `subject`, `variant` and `seed`, added and removed keys, and keys that another
            key replaces.
    """
    for override in overrides:
        key, _, value = override.partition("=")
        if key in ("subject", "variant", "seed"):
            raise SettingsError(f"{_shown(override)}: a study has several; choose them by study.{key}s=[{value[:60]}]")
        if key.startswith(("+", "~")):
            raise SettingsError(f"{_shown(override)}: keys can be set, neither added nor removed")
        for set_key in (key, *_keys_below(key, parse_override(override))):
            if advice := replacement(set_key):
                raise SettingsError(f"{set_key}: {advice}")


def _keys_below(key: str, override: Override) -> Iterator[str]:
    """Dotted keys of a value that is a mapping, as in `train={iterations:9}`."""
    value = None if override.is_sweep_override() else override.value()
    pending = [(key, value)]
    while pending:
        above, value = pending.pop()
        for name, below in value.items() if isinstance(value, dict) else ():
            yield f"{above}.{name}"
            pending.append((f"{above}.{name}", below))
