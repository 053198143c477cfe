"""Values of presets relative to those of the study: `${times:0.5}` is half of what the key has without the preset."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from omegaconf import DictConfig, Node, OmegaConf


@contextmanager
def relative_to(compose_without: Callable[[], DictConfig]) -> Iterator[None]:
    """Define OmegaConf's resolver `times` for the settings that are resolved in the block.

    Args:
        compose_without: Composes the same settings without the preset; called at most once.

    Yields:
        Nothing.

    Raises:
        ValueError: Something that stays without the preset uses `times`, too.
    """
    compose_once = cache(compose_without)

    def times(factor: float, *, _node_: Node) -> Any:
        OmegaConf.register_new_resolver("times", _refuse, replace=True)
        value = OmegaConf.select(compose_once(), _node_._get_full_key(None))
        OmegaConf.register_new_resolver("times", times, replace=True)
        return round(factor * value) if isinstance(value, int) else factor * value

    OmegaConf.register_new_resolver("times", times, replace=True)
    try:
        yield
    finally:
        OmegaConf.clear_resolver("times")


def _refuse(factor: float) -> Any:
    raise ValueError(f"${{times:{factor:g}}}: only a preset can multiply what the study has")
