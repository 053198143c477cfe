"""Sections of the settings as YAML files, one for each job."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from carigs.config.composition import compose
from carigs.config.hydra_errors import describe
from carigs.config.literals import literal
from carigs.errors import InputError, SettingsError
from carigs.readers.yaml_files import read_yaml_text
from carigs.settings import STAGES, Config
from carigs.settings.option import Section, copies, walk


def settings_text(stage: str, *overrides: str) -> str:
    """The YAML text of one section.

    Args:
        stage: Name of the section.
        *overrides: Hydra overrides.

    Returns:
        The section with everything resolved: a `${` in it is text.
    """
    return yaml_text(compose(*overrides)[stage])


def yaml_text(section: DictConfig) -> str:
    """A section as YAML that `load_settings` reads back.

    Args:
        section: Composed settings, or a section of them.

    Returns:
        Its text: values as they are, without interpolations.
    """
    values = OmegaConf.to_container(section, resolve=True)
    return yaml.dump(values, Dumper=_Dumper, allow_unicode=True, sort_keys=False)


def keys_text(config: DictConfig, section: str | None = None) -> str:
    """Composed settings as YAML, without fields that are set by other keys: a study of one's own may hold it.

    Args:
        config: All settings, composed.
        section: Name of a section for that alone.

    Returns:
        The text.
    """
    shown = OmegaConf.masked_copy(config, [*config])
    for field, _ in copies(Config):
        above, _, name = field.rpartition(".")
        OmegaConf.set_struct(within := OmegaConf.select(shown, above) if above else shown, False)
        del within[name]
    return yaml_text(shown[section] if section else shown)


class _Dumper(yaml.SafeDumper):
    """Writes line breaks and other characters that are not printable as escapes: elsewhere YAML folds some of them."""


def _represent_text(dumper: _Dumper, text: str) -> yaml.Node:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if text.isprintable() else '"')


_Dumper.add_representer(str, _represent_text)


def load_settings(stage: str, file: str | Path) -> Section:
    """Load the frozen section of a stage.

    Args:
        stage: Name of the section.
        file: YAML as written by `settings_text`.

    Returns:
        The section's dataclass.

    Raises:
        InputError: For a broken file, missing or unknown keys, wrong types and values out of range.
    """
    text, schema = read_yaml_text(file), STAGES[stage]
    try:
        found = yaml.safe_load(text) or {}
        section = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(schema), literal(found)))
    except (OmegaConfBaseException, yaml.YAMLError, SettingsError, ValueError, OverflowError) as error:
        raise InputError(describe(error, stage), file=file) from error
    present = set(_keys(found))
    for key in (key.removeprefix(f"{stage}.") for key, _, _ in walk(schema)):
        if key not in present:  # else a file that was cut off would mean defaults
            raise InputError("this key is missing", file=file, field=key)
    return section


def _keys(values: dict[str, Any], at: str = "") -> Iterator[str]:
    """All dotted keys of nested mappings."""
    for name, value in values.items():
        yield f"{at}{name}"
        if isinstance(value, dict):
            yield from _keys(value, f"{at}{name}.")
