"""Values of presets relative to those of the study.

`${times:0.5}` is half of what the key has without the preset, `${at_least:2}` that value or 2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

from omegaconf import DictConfig, Node, OmegaConf

Relation = Callable[[float, float], float]


def times(factor: float, value: float) -> float:
    """Multiply; whole numbers stay whole.

    Args:
        factor: Factor of the preset.
        value: Value of the study.

    Returns:
        The product, rounded if the value is an integer.
    """
    return round(factor * value) if isinstance(value, int) else factor * value


RELATIONS: Mapping[str, Relation] = {"times": times, "at_least": max}


@contextmanager
def relative_to(compose_without: Callable[[], DictConfig]) -> Iterator[None]:
    """Define OmegaConf's resolvers `times` and `at_least` for the settings that are resolved in the block.

    Args:
        compose_without: Composes the same settings without the preset; called at most once.

    Yields:
        Nothing.

    Raises:
        ValueError: Something that stays without the preset uses them, too, or with anything but a number.
    """
    compose_once = cache(compose_without)

    def resolver(relation: Relation) -> Callable[..., Any]:
        def resolve(operand: float, *, _node_: Node) -> float:
            if isinstance(operand, bool) or not isinstance(operand, int | float):
                raise ValueError(f"{operand!r} is no decimal number")
            _register(lambda _: _refuse)  # what the study has must not be relative itself
            value = OmegaConf.select(compose_once(), _node_._get_full_key(None))
            _register(resolver)
            return relation(operand, value)

        return resolve

    _register(resolver)
    try:
        yield
    finally:
        for name in RELATIONS:
            OmegaConf.clear_resolver(name)


def _register(resolver: Callable[[Relation], Callable[..., Any]]) -> None:
    for name, relation in RELATIONS.items():
        OmegaConf.register_new_resolver(name, resolver(relation), replace=True)


def _refuse(operand: float) -> float:
    raise ValueError("only a preset can be relative to what the study has")
