"""Checks of what files of `conf/` hold: keys that are replaced, and values that YAML does not read as people do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import GrammarParseError

from carigs.config.plain_numbers import is_ambiguous
from carigs.config.text_values import TEXT, TEXTS, kinds_of_values
from carigs.config.unknown_keys import replacement
from carigs.errors import InputError


def check_values(text: str, file: Path) -> None:
    """Refuse keys that another key replaces, and what YAML changes: of `010` it makes 8, of the text `007` it leaves 7.

    Args:
        text: Text of the file, as returned by `read_yaml_text`.
        file: The file, for messages.

    Raises:
        InputError: For the first key that is replaced, the first number or boolean where the settings hold text, the
            first number that is not plainly decimal, the first name that is no text, and a broken interpolation.
    """
    at = "exaggerate." if file.parent.name == "exaggerate" else ""
    try:
        for key, name, node in _leaves(yaml.compose(text, Loader=yaml.SafeLoader), at):
            _check(key, name, node, file)
        OmegaConf.to_container(OmegaConf.create(text))
    except GrammarParseError as error:
        raise InputError(r"a `${` that starts no interpolation; type `\${`", file=file) from error


def _check(key: str, name: yaml.ScalarNode, node: yaml.Node, file: Path) -> None:
    """Check a name and its value."""
    if advice := replacement(key):
        raise InputError(advice, file=file, field=key)
    if not isinstance(read := _reading(name), str):
        raise InputError(f"YAML reads the name as {read!r}, not as text; quote it", file=file, field=key)
    kind = kinds_of_values().get(key)
    for element in _elements(node) if kind else ():
        read = _reading(element)
        if kind in (TEXT, TEXTS):
            if isinstance(read, bool | int | float):
                raise InputError(f"YAML reads the value as {read!r}, not as text; quote it", file=file, field=key)
        elif element.style is None and is_ambiguous(element.value):
            problem = f"YAML reads {element.value[:40]} as {read!r}; write it in decimal digits"
            raise InputError(problem, file=file, field=key)


def _leaves(node: yaml.Node | None, at: str) -> Iterator[tuple[str, yaml.ScalarNode, yaml.Node]]:
    """Dotted keys, names and values of nested mappings."""
    for name, value in node.value if isinstance(node, yaml.MappingNode) else ():
        key = f"{at}{name.value}"
        yield key, name, value
        yield from _leaves(value, f"{key}.")


def _elements(node: yaml.Node) -> Iterator[yaml.ScalarNode]:
    """The scalars of a value: itself, or those in it."""
    if isinstance(node, yaml.ScalarNode):
        yield node
    elif isinstance(node, yaml.SequenceNode):
        for element in node.value:
            yield from _elements(element)
    else:
        for _, element in node.value:
            yield from _elements(element)


def _reading(scalar: yaml.ScalarNode) -> Any:
    """What OmegaConf makes of a scalar."""
    if scalar.style is not None:
        return scalar.value
    return OmegaConf.to_container(OmegaConf.create(f"value: {scalar.value}"))["value"]
