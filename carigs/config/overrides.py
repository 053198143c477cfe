"""Hydra overrides: their line on the command line, and which are refused before Hydra parses them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable

from carigs.errors import SettingsError

MAX_OVERRIDE_BYTES = 30_000
"""Of all overrides together: Linux allows 131072 bytes for the command of a job, in which they are quoted twice."""
MAX_OVERRIDE = 10_000
"""Longest override in characters."""
MAX_BRACKETS = 32
"""Most opening brackets of an override: the time of Hydra's parser grows quickly with their depth."""


def split_overrides(text: str) -> tuple[str, ...]:
    """Split a line of overrides on blanks, with the quotes of a shell.

    Args:
        text: The value of Snakemake's `--config hydra=`.

    Returns:
        The overrides.

    Raises:
        SettingsError: For an open quote.
    """
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        reason = "Snakemake removes a quote at the end of the value; type a blank after it"
        example = "\"hydra=metrics.edit_prompt='A nose' \""
        raise SettingsError(f"hydra={text}: {error}. {reason}, as in --config {example}") from error


def join_overrides(overrides: Iterable[str]) -> str:
    """Join overrides for Snakemake's `--config hydra=`.

    Args:
        overrides: Hydra overrides.

    Returns:
        The line that `split_overrides` splits again. Backslashes, because Snakemake removes quotes at the ends of a
        value; the blanks keep a last one. (A value of nothing but blanks is an error of Snakemake's parser.)
    """
    return "".join(re.sub(r"([\s'\"\\])", r"\\\1", override) + " " for override in overrides)


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
    """Refuse overrides that a study cannot have, because it sets the keys itself or passes all of them on to its jobs.

    Args:
        overrides: Hydra overrides.

    Raises:
        SettingsError: For overrides of `subject`, `variant` and `seed`, added and removed keys, and overrides that are
            too long for the command line of a job.
    """
    if (length := sum(len(override.encode()) + 1 for override in overrides)) > MAX_OVERRIDE_BYTES:
        problem = f"the overrides have {length} bytes, more than {MAX_OVERRIDE_BYTES}"
        raise SettingsError(f"{problem}; write them into a file conf/study/NAME.yaml")
    for override in overrides:
        key, _, value = override.partition("=")
        if key in ("subject", "variant", "seed"):
            raise SettingsError(f"{override}: a study has several; choose them by study.{key}s=[{value}]")
        if key.startswith(("+", "~")):
            raise SettingsError(f"{override}: keys can be set, neither added nor removed")
