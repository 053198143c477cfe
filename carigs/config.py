"""The settings of a study: composed by Hydra from `conf/`, frozen as YAML for each stage, loaded as dataclasses."""

from __future__ import annotations

import re
import shlex
from dataclasses import field, fields, is_dataclass, make_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.errors import HydraException, MissingConfigException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from carigs.errors import InputError, SettingsError
from carigs.settings import STAGES, Density, RefineTracking, Study, Toy, check

CONF = Path(__file__).parents[1] / "conf"
OF_A_VARIANT = ("gtstar", "train")
"""Sections that a variant may change."""

Config = make_dataclass(
    "Config",
    [
        ("gamma", float, 0.25),
        ("study", Study, field(default_factory=Study)),
        *((name, schema, field(default_factory=schema)) for name, schema in STAGES.items()),
    ],
)
"""The whole tree: gamma_f, the study, and one section per stage."""

_schema = OmegaConf.structured(Config)
# The names of regions come with the head model: here alone keys may be added.
OmegaConf.set_struct(_schema.exaggerate.regions, False)
ConfigStore.instance().store("schema", _schema)


@cache
def compose(*overrides: str) -> DictConfig:
    """The composed settings; of two overrides of one key the later wins.

    Raises `SettingsError`, in one line that names the key and the known ones, for typos, wrong types, unknown choices.
    """
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            config = hydra_compose("config", list(overrides))
            OmegaConf.resolve(config)
    except (HydraException, OmegaConfBaseException, YAMLError) as error:
        raise SettingsError(_one_line(error)) from error
    _check(config)
    return config


def split_overrides(text: str) -> tuple[str, ...]:
    """The overrides in one line: split on blanks, quoted as in a shell."""
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        raise SettingsError(f"{text}: {error}; a blank after the last quote keeps Snakemake from taking it") from error


def compose_study(*overrides: str) -> DictConfig:
    """`compose` for what a user asks for: subjects and variants come from the study, so they cannot be overrides."""
    for override in overrides:
        key, _, value = override.partition("=")
        if key in ("subject", "variant"):
            raise SettingsError(f"{override}: a study has several; choose them by study.{key}s=[{value}]")
        if key.startswith(("+", "~")):
            raise SettingsError(f"{override}: keys can be set, neither added nor removed")
    return compose(*overrides)


def compose_variant(variant: str, *overrides: str) -> DictConfig:
    """`compose` at a variant; raises `SettingsError` where it changes what all variants share."""
    config, shared = compose(*overrides, f"variant={variant}"), compose(*overrides)
    for stage in STAGES.keys() - OF_A_VARIANT:
        for key in config[stage]:
            if config[stage][key] != shared[stage][key]:
                allowed = " and ".join(OF_A_VARIANT)
                raise SettingsError(f"variant/{variant}.yaml: {stage}.{key} is shared; a variant has its own {allowed}")
    return config


def rendered_levels(config: DictConfig) -> list[str]:
    """The levels that a model trained for gamma is rendered at: 0, gamma, and the study's in between, as in paths."""
    inside = {level for level in config.study.levels if level < config.gamma}
    return list(dict.fromkeys(f"{level:g}" for level in sorted({0.0, *inside, config.gamma})))


def target_levels(train: DictConfig, gamma: float) -> list[str]:
    """The levels whose GT* frames training reads, as in paths: `train.num_gtstar_levels` of them, evenly up to gamma.

    Gamma alone where only the light that was fitted for them is wanted; none for the baseline.
    """
    if train.gtstar_probability == 0:
        return [f"{gamma:g}"] if train.relight_surfels else []
    return [f"{gamma * k / train.num_gtstar_levels:g}" for k in range(1, train.num_gtstar_levels + 1)]


def target_maker(variant: str, *overrides: str) -> str:
    """The first variant with the settings of `gtstar` that `variant` has: targets are made once, in its name."""
    wanted = compose(*overrides, f"variant={variant}").gtstar
    names = ("alternating", *known("variant"))
    return next(name for name in names if compose(*overrides, f"variant={name}").gtstar == wanted)


def settings_text(stage: str, *overrides: str) -> str:
    """The YAML that a stage is given: its own section, everything resolved."""
    return OmegaConf.to_yaml(compose(*overrides)[stage])


def load_settings(stage: str, file: str | Path) -> Any:
    """The frozen section of a stage as its dataclass."""
    try:
        return _tuples(OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(STAGES[stage]), OmegaConf.load(file))))
    except (OmegaConfBaseException, YAMLError) as error:
        raise InputError(_one_line(error), file=file) from error


def known(group: str) -> list[str]:
    """The choices of a configuration group; names with an underscore are parts that the others share."""
    return sorted(path.stem for path in (CONF / group).glob("[!_]*.yaml"))


def _check(config: DictConfig) -> None:
    """What types cannot say."""
    study = config.study
    if not re.fullmatch(r"[\w.-]+", study.name):
        raise SettingsError(f"study.name={study.name}: letters, digits and ._- only, it becomes a folder")
    for group in ("subject", "variant"):
        names = study[f"{group}s"]
        if not names or len(set(names)) < len(names):
            raise SettingsError(f"study.{group}s={list(names)}: expected one or more different names")
        for name in names:
            if name not in known(group):
                raise SettingsError(f"study.{group}s: {name} is unknown; known: {', '.join(known(group))}")
    for stage in STAGES:
        check(stage, config[stage])
    if not 1e-4 <= config.gamma <= 100:
        raise SettingsError(f"gamma={config.gamma:g} is outside [0.0001, 100]")
    for level in study.levels:
        if not 0 <= level <= 100:
            raise SettingsError(f"study.levels: {level:g} is outside [0, 100]")
    if not 1 <= config.train.num_gtstar_levels <= 64:
        raise SettingsError(f"train.num_gtstar_levels={config.train.num_gtstar_levels} is outside [1, 64]")


def _one_line(error: Exception) -> str:
    """Hydra's and OmegaConf's reports take several lines and leave out what would have been right."""
    if isinstance(error, MissingConfigException):
        group, _, name = str(error.missing_cfg_file).rpartition("/")
        return f"{group}={name} is unknown; known: {', '.join(known(group))}"
    text = str(error.__cause__ if isinstance(error.__cause__, OmegaConfBaseException) else error)
    detail = r"^\s*(full_key|object_type|reference_type)[:=]\s*(.*)$"
    details = dict(re.findall(detail, text, re.MULTILINE))
    problem = " ".join(re.sub(rf"{detail}|^See https.*$", "", text, flags=re.MULTILINE).split())
    schemas = {schema.__name__: schema for schema in (Config, Study, Toy, Density, RefineTracking, *STAGES.values())}
    if "Key '" in problem and (schema := schemas.get(details.get("object_type", ""))):
        problem += f"; known: {', '.join(f.name for f in fields(schema))}"
    where = details.get("full_key") or getattr(error, "override", None)
    return f"{where}: {problem}" if where else problem


def _tuples(settings: Any) -> Any:
    """OmegaConf hands sequences out as lists; the dataclasses promise tuples."""
    for f in fields(settings):
        value = getattr(settings, f.name)
        if isinstance(value, list):
            setattr(settings, f.name, tuple(value))
        elif is_dataclass(value):
            _tuples(value)
    return settings
