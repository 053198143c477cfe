"""Sweeps: the combinations of several values of overrides, and the study folder of each combination."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from hashlib import sha256
from itertools import islice, product
from math import prod
from typing import Any, NamedTuple

from hydra.core.override_parser.types import QuotedString, Transformer
from hydra.errors import HydraException

from carigs.config.composition import compose_study
from carigs.config.overrides import check_study_overrides, parse_override
from carigs.config.text_values import TEXT, kinds_of_values, with_quotes
from carigs.errors import SettingsError

MAX_COMBINATIONS = 10_000
MAX_FOLDER_BYTES = 120
"""Of the folder of a combination, and of the name of a sweep; a file name may have 255 bytes."""
_PLAIN = re.compile(r"[a-z0-9_-]+(\.[a-z0-9_-]+)*")
"""What a folder shows as it is. Without capitals: some file systems do not tell them apart."""


class Combination(NamedTuple):
    """One value for each key of a sweep."""

    study: str
    """Folder of its results below `results/`; combinations that differ in gamma alone share it."""
    values: tuple[str, ...]
    """Text of the value of each key."""
    overrides: tuple[str, ...]
    """Hydra overrides of the combination, those that all combinations have first."""


class SweepGrid(NamedTuple):
    """All combinations of the values of some keys."""

    study: str
    """Study in whose folder the table and the figure are."""
    keys: tuple[str, ...]
    """Keys with several values, in the order in which they were given."""
    combinations: tuple[Combination, ...]
    """The last key changes fastest."""

    @property
    def name(self) -> str:
        """Name of the files of the sweep: its keys."""
        return _short_name(",".join(self.keys), all(map(_PLAIN.fullmatch, self.keys)))


def split_sweep(overrides: Sequence[str]) -> tuple[list[str], list[str]]:
    """Separate overrides with one value from those with several.

    Args:
        overrides: Hydra overrides, some with several values: `gamma=0.1,0.2` or `capture.toy.seed=range(3)`.

    Returns:
        Those with one value, and those with several.

    Raises:
        SettingsError: For an override that Hydra cannot parse.
    """
    parts: tuple[list[str], list[str]] = ([], [])
    for override in overrides:
        parts[parse_override(override).is_sweep_override()].append(override)
    return parts


def read_sweep(overrides: Sequence[str], swept: Sequence[str]) -> SweepGrid:
    """List the combinations of a sweep.

    Args:
        overrides: Hydra overrides that all combinations have.
        swept: Hydra overrides with several values; of two for one key the later wins.

    Returns:
        The combinations, each set of values once.

    Raises:
        SettingsError: For an override that Hydra cannot parse or that a study cannot have, for values that cannot be
            listed, for no value, and for more than `MAX_COMBINATIONS` combinations.
    """
    check_study_overrides((*overrides, *swept))
    choices = dict(_choices(override) for override in swept)
    if prod(map(len, choices.values())) > MAX_COMBINATIONS:
        raise SettingsError(f"a sweep has at most {MAX_COMBINATIONS} combinations of values")
    if not choices:
        raise SettingsError("no key has several values: expected some as in gamma=0.1,0.2")
    studies: dict[tuple[str, ...], str] = {}
    found: list[Combination] = []
    for combination in product(*(choice.items() for choice in choices.values())):
        texts, added = zip(*combination, strict=True)
        single = (*overrides, *added)
        chosen = tuple(override for override in single if override.startswith(("study=", "study.name=")))
        if chosen not in studies:  # nothing else changes the name: composing every combination would take long
            studies[chosen] = compose_study(*single).study.name
        folder = combination_folder(studies[chosen], dict(zip(choices, texts, strict=True)))
        found.append(Combination(folder, texts, single))
    return SweepGrid(next(iter(studies.values())), (*choices,), (*found,))


def study_table(overrides: Sequence[str], sweep: SweepGrid | None) -> dict[str, list[tuple[str, ...]]]:
    """The studies of a run.

    Args:
        overrides: Hydra overrides of the run, without those that have several values.
        sweep: The sweep, if the run is one.

    Returns:
        By folder below `results/` the overrides of each combination whose results are in it: one for each gamma.

    Raises:
        SettingsError: For overrides that cannot be composed.
    """
    if sweep is None:
        return {compose_study(*overrides).study.name: [tuple(overrides)]}
    table: dict[str, list[tuple[str, ...]]] = {}
    for combination in sweep.combinations:
        table.setdefault(combination.study, []).append(combination.overrides)
    return table


def combination_folder(study: str, values: Mapping[str, str]) -> str:
    """Name the folder of a combination; gamma is in the paths below it.

    Args:
        study: Name of the study.
        values: Text of the value of each key, as made by `value_text`.

    Returns:
        `study+key=value,key=value`, keys sorted. A name that would be too long, or a value that is not made of small
        letters, digits and `._-`, is told apart by a digest: `study+shortened+digest`. Equal values have equal names,
        different values different ones. A `+` is in no name of a study.
    """
    named = {key: values[key] for key in sorted(values) if key != "gamma"}
    if not named:
        return study
    plain = all(_PLAIN.fullmatch(part) for pair in named.items() for part in pair)
    text = ",".join(f"{key}={value}" for key, value in named.items())
    return f"{study}+{_short_name(text, plain, json.dumps(named), MAX_FOLDER_BYTES - len(study.encode()) - 1)}"


def value_text(value: Any) -> str:
    """The text of a value: of equal values the same, of different values different ones.

    Args:
        value: As Hydra's parser returns it.

    Returns:
        A word as it is; anything else as JSON, numbers in their shortest form.
    """
    value = _simplified(value)
    if isinstance(value, str) and _PLAIN.fullmatch(value) and not _is_other_type(value):
        return value
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def _short_name(text: str, plain: bool, told_apart: str = "", limit: int = MAX_FOLDER_BYTES) -> str:
    """The text itself if it is plain and short enough, else its start with a digest."""
    if plain and len(text) <= limit:
        return text
    digest = sha256((told_apart or text).encode()).hexdigest()[:16]
    return f"{re.sub('[^a-z0-9_.,=-]+', '-', text.lower())[: limit - 17]}+{digest}"


def _choices(override: str) -> tuple[str, dict[str, str]]:
    """The key of an override, and by text of a value the override with this value alone."""
    parsed = parse_override(override)
    key = parsed.get_key_element()
    if not parsed.is_sweep_override():
        return key, {_text(key, parsed.value()): override}
    try:
        values = parsed.sweep_iterator(lambda value: (_text(key, value), f"{key}={_encoded(key, value)}"))
        choices = dict(islice(values, MAX_COMBINATIONS + 1))
    except HydraException as error:
        raise SettingsError(f"{override}: list the values, or use range(); {str(error).splitlines()[0]}") from error
    if not choices:
        raise SettingsError(f"{override}: no value")
    return key, choices


def _encoded(key: str, value: Any) -> str:
    """A value in Hydra's grammar; of `choice('a')` the parser keeps the text without its quotes."""
    is_bare = isinstance(value, str) and kinds_of_values().get(key) == TEXT
    return with_quotes(value) if is_bare else Transformer.encode(value)


def _text(key: str, value: Any) -> str:
    """The text of the value of a key; of gamma as in paths."""
    return f"{value:g}" if key == "gamma" and isinstance(value, int | float) else value_text(value)


def _simplified(value: Any) -> Any:
    """Strings without marks of their quotes, whole numbers as integers."""
    if isinstance(value, QuotedString):
        return value.text
    if isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, dict):
        return {str(key): _simplified(element) for key, element in value.items()}
    return [_simplified(element) for element in value] if isinstance(value, list) else value


def _is_other_type(word: str) -> bool:
    """Whether a number, a boolean or nothing has the same text as a word."""
    try:
        float(word)
    except ValueError:
        return word in ("null", "true", "false")
    return True
