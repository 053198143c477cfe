"""Compositions by Hydra, of which many share the choices of their groups.

Most of the time of a composition goes into the choices: which files they are, and which of their values holds. A run
composes its settings for every subject, variant, seed and gamma. So the composition of choices is kept, and values are
set in a copy of it, as Hydra does.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from hydra import compose, initialize_config_dir
from hydra.conf import HydraConf
from hydra.core.config_store import ConfigNode, ConfigStore
from hydra.core.override_parser.types import Override, OverrideType
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from carigs.config.conf_files import SEARCH_PATH, ConfFile, names_asked, read_choice
from carigs.config.folders import GROUPS
from carigs.settings import Config
from carigs.settings.option import OF_PATH, copies, walk


class _Copied:
    """Settings of which every copy is made by `pickle`, in a sixth of the time of OmegaConf's own."""

    def __init__(self, settings: DictConfig) -> None:
        self._pickled = pickle.dumps(settings)

    def __deepcopy__(self, memo: dict) -> DictConfig:
        return pickle.loads(self._pickled)


class _Store(dict):
    """What Hydra finds in its store. Hydra copies the whole store for each composition, and each part that it reads."""

    def __deepcopy__(self, memo: dict) -> _Store:
        return self


def _schema() -> DictConfig:
    """The dataclasses of the settings, with interpolations where a key has the value of another one."""
    schema = OmegaConf.structured(Config)
    for field, key in copies(Config):
        if key != OF_PATH:
            OmegaConf.update(schema, field, f"${{{key}}}")
    # The names of regions come with the head model: here alone keys may be added.
    OmegaConf.set_struct(schema.exaggerate.regions, False)
    return schema


def _node(name: str, settings: DictConfig, group: str | None = None) -> ConfigNode:
    return ConfigNode(name=name, node=_Copied(settings), group=group, package=None, provider="carigs")


SCHEMA = _schema()
# Hydra reads the first file before it knows the search path, hence this one.
_FIRST_FILE = OmegaConf.create({"defaults": ["config", "_self_"], "hydra": {"searchpath": [SEARCH_PATH]}})
# Of Hydra's own configuration nothing is used: composing its groups takes a third of the time.
_WITHOUT_GROUPS = OmegaConf.structured(HydraConf(defaults=[]))
_STORE = _Store(
    {
        "carigs.yaml": _node("carigs.yaml", _FIRST_FILE),
        "schema.yaml": _node("schema.yaml", SCHEMA),
        "hydra": {"config.yaml": _node("config.yaml", _WITHOUT_GROUPS, "hydra")},
    }
)
_KEYS = frozenset(key for key, _, _ in walk(Config))
_FOLDER = str(Path(__file__).parent)
"""Without files for Hydra: `initialize` of a module's folder reads the stack, which takes a sixth of a composition."""


def composed(overrides: Sequence[Override]) -> DictConfig:
    """Compose settings.

    Args:
        overrides: Parsed overrides, each with one value.

    Returns:
        What Hydra composes; interpolations are not resolved.

    Raises:
        HydraException: For unknown keys and choices, and wrong types.
        InputError: For a broken file in `conf/` that the choices need.
    """
    values = [override for override in overrides if _is_value(override)]
    choices = [override for override in overrides if not _is_value(override)]
    if all(map(_is_choice, choices)):
        settings = _of_choices(tuple(override.input_line for override in choices))
        try:
            for override in values:
                OmegaConf.update(settings, override.key_or_group, override.value())
            return settings
        except OmegaConfBaseException:
            pass  # Hydra's error names the override
    return by_hydra(override.input_line for override in overrides)


def _is_value(override: Override) -> bool:
    """Whether an override sets a key that every composition has."""
    return _is_change(override) and override.key_or_group in _KEYS


def _is_choice(override: Override) -> bool:
    """Whether an override chooses a file; `exaggerate={iterations:3}` sets a key of the section with the same name."""
    return _is_change(override) and override.key_or_group in GROUPS and not isinstance(override.value(), dict)


def _is_change(override: Override) -> bool:
    return override.type == OverrideType.CHANGE and override.package is None


class _Composition(NamedTuple):
    settings: bytes
    """Pickled."""
    files: Mapping[str, ConfFile | None]
    """What was found by each name that Hydra asked for."""


def _of_choices(choices: tuple[str, ...]) -> DictConfig:
    """The composition of choices; a kept one if its files are still the same."""
    kept = _kept.get(choices)
    if kept is None or any(read_choice(name) != file for name, file in kept.files.items()):
        with names_asked() as names:
            settings = by_hydra(choices)
        kept = _Composition(pickle.dumps(settings), {name: read_choice(name) for name in names})
        _kept[choices] = kept
    return pickle.loads(kept.settings)


_kept: dict[tuple[str, ...], _Composition] = {}


def by_hydra(lines: Iterable[str]) -> DictConfig:
    """Compose settings anew, choices and values together.

    Args:
        lines: Overrides in Hydra's grammar.

    Returns:
        As `composed`.

    Raises:
        HydraException: As `composed`.
        InputError: As `composed`.
    """
    with _own_store(), initialize_config_dir(_FOLDER, job_name="carigs", version_base="1.3"):
        return compose("carigs", [*lines])


@contextmanager
def _own_store() -> Iterator[None]:
    """Within it, Hydra finds in its store what is of carigs alone; a program may use Hydra for itself."""
    store = ConfigStore.instance()
    before, store.repo = store.repo, _STORE
    try:
        yield
    finally:
        store.repo = before
