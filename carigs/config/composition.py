"""Composition of the settings of a study by Hydra, and their checks."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from carigs.config.conf_files import SEARCH_PATH
from carigs.config.hydra_errors import describe
from carigs.config.levels import rendered_levels
from carigs.config.literals import literal
from carigs.config.names import check_names, expand_patterns
from carigs.config.overrides import check_study_overrides, hydra_override
from carigs.config.relative import relative_to
from carigs.errors import SettingsError
from carigs.settings import Config, combine_mask_flags
from carigs.settings.option import OF_PATH, check_section, copies

_schema = OmegaConf.structured(Config)
for _field, _key in copies(Config):
    if _key != OF_PATH:
        OmegaConf.update(_schema, _field, f"${{{_key}}}")
# The names of regions come with the head model: here alone keys may be added.
OmegaConf.set_struct(_schema.exaggerate.regions, False)
ConfigStore.instance().store("schema", _schema)
# Of Hydra's own configuration nothing is used: composing it takes a third of the time.
_HYDRA_GROUPS = ("output", "launcher", "sweeper", "help", "hydra_help", "hydra_logging", "job_logging", "env")
_WITHOUT_HYDRA = [{f"override hydra/{group}": None} for group in _HYDRA_GROUPS]
# Hydra reads the first file before it knows the search path, hence this one.
_FIRST_FILE = {"defaults": ["config", "_self_", *_WITHOUT_HYDRA], "hydra": {"searchpath": [SEARCH_PATH]}}
ConfigStore.instance().store("carigs", _FIRST_FILE)
_FOLDER = str(Path(__file__).parent)
"""Without files for Hydra: `initialize` of a module's folder reads the stack, which takes a sixth of a composition."""


@cache
def compose(*overrides: str) -> DictConfig:
    """Compose and check the settings.

    Args:
        *overrides: Hydra overrides; of two for one key the later wins.

    Returns:
        All settings, interpolations resolved, once, `mask_flags` combined, and `render.levels` without those above
        gamma.

    Raises:
        SettingsError: For unknown keys and choices, wrong types and values out of range, in one line.
        InputError: For a broken file in `conf/` that the choices need.
    """
    typed = [hydra_override(override) for override in overrides]
    try:
        with initialize_config_dir(_FOLDER, job_name="carigs", version_base="1.3"):
            config = hydra_compose("carigs", typed)
            with relative_to(lambda: hydra_compose("carigs", [*typed, "preset=balanced"])):
                values = OmegaConf.to_container(config, resolve=True)
                if (literals := literal(values)) == values:
                    OmegaConf.resolve(config)  # takes a tenth of the time of a merge
                else:
                    config = OmegaConf.merge(_schema, literals)
    except (HydraException, OmegaConfBaseException, YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise SettingsError(describe(error)) from error
    check_section(Config, config)
    config.render.levels = [*map(float, rendered_levels(config))]
    config.study.variants = expand_patterns(config.study.variants)
    check_names(config)
    combine_mask_flags(config.train)
    return config


def compose_study(*overrides: str) -> DictConfig:
    """Compose what a user asks for; subjects, variants and seeds come from the study, so they cannot be overrides.

    Args:
        *overrides: Hydra overrides.

    Returns:
        As `compose`.

    Raises:
        SettingsError: As `compose`, and as `check_study_overrides`.
    """
    check_study_overrides(overrides)
    return compose(*overrides)
