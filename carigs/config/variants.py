"""Variants of a study: their settings, and which of them share GT* frames."""

from __future__ import annotations

from contextlib import suppress

from omegaconf import DictConfig

from carigs.config.composition import compose
from carigs.config.folders import known
from carigs.errors import CarigsError, SettingsError
from carigs.settings import STAGES

VARIANT_SECTIONS = ("gtstar", "train")
"""Sections that a variant may change."""


def compose_variant(variant: str, *overrides: str) -> DictConfig:
    """Compose the settings of one variant.

    Args:
        variant: Name of the variant.
        *overrides: Hydra overrides.

    Returns:
        As `compose`.

    Raises:
        SettingsError: As `compose`, and where the variant changes a section that all variants share.
    """
    config, shared = compose(*overrides, f"variant={variant}"), compose(*overrides)
    for stage in STAGES.keys() - VARIANT_SECTIONS:
        for key in config[stage]:
            if config[stage][key] != shared[stage][key]:
                allowed = " and ".join(VARIANT_SECTIONS)
                raise SettingsError(f"variant/{variant}.yaml: {stage}.{key} is shared; a variant has its own {allowed}")
    return config


def target_maker(variant: str, *overrides: str) -> str:
    """The first variant with the same settings of `gtstar`: GT* frames are made once, in its name.

    Args:
        variant: Name of the variant that needs GT* frames.
        *overrides: Hydra overrides.

    Returns:
        Name of the variant in whose folder they are.
    """
    needed = compose(*overrides, f"variant={variant}").gtstar
    for name in ("alternating", *known("variant")):
        with suppress(CarigsError):  # a variant that is broken shares nothing
            if compose(*overrides, f"variant={name}").gtstar == needed:
                return name
    return variant
