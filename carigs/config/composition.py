"""Composition of the settings of a study by Hydra, and their checks."""

from __future__ import annotations

from functools import cache

from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from carigs.config.hydra_calls import SCHEMA, composed
from carigs.config.hydra_errors import describe
from carigs.config.levels import rendered_levels
from carigs.config.literals import literal
from carigs.config.names import check_names, expand_patterns
from carigs.config.overrides import check_study_overrides, parse_single
from carigs.config.relative import relative_to
from carigs.errors import SettingsError
from carigs.settings import Config, combine_mask_flags
from carigs.settings.option import check_section


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
    parsed = [parse_single(override) for override in overrides]
    try:
        config = composed(parsed)
        with relative_to(lambda: composed([*parsed, parse_single("preset=balanced")])):
            values = OmegaConf.to_container(config, resolve=True)
            if (literals := literal(values)) == values:
                OmegaConf.resolve(config)  # takes a tenth of the time of a merge
            else:
                config = OmegaConf.merge(SCHEMA, literals)
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
