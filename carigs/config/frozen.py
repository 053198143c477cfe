"""Sections of the settings as YAML files, one for each job."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from carigs.config.composition import compose
from carigs.config.hydra_errors import describe
from carigs.errors import InputError, SettingsError
from carigs.readers.yaml_files import read_yaml_text
from carigs.settings import STAGES
from carigs.settings.option import Section, walk


def settings_text(stage: str, *overrides: str) -> str:
    """The YAML text of one section.

    Args:
        stage: Name of the section.
        *overrides: Hydra overrides.

    Returns:
        The section with everything resolved.
    """
    return OmegaConf.to_yaml(compose(*overrides)[stage])


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
        found = OmegaConf.create(text)
        section = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(schema), found))
    except (OmegaConfBaseException, YAMLError, SettingsError, ValueError, OverflowError) as error:
        raise InputError(describe(error), file=file) from error
    present = set(_keys(OmegaConf.to_container(found)))
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
