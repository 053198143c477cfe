"""The settings of a study: composed by Hydra from `conf/`, frozen as YAML for each stage, loaded as dataclasses.

Hydra finds groups in the project's `conf/` and in a folder `conf/` of the current directory, for subjects, variants and
studies of your own.
"""

from __future__ import annotations

import fnmatch
import re
import shlex
from collections.abc import Iterator
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
from carigs.readers.yaml_files import check_yaml, read_yaml_text
from carigs.settings import STAGES, Config, combine_mask_flags
from carigs.settings.option import Section, check_section, walk


def project_root() -> Path:
    """The folder with `Snakefile`, `conf`, `workflow` and `profiles`.

    Returns:
        `carigs/_project` of an installed package, else the root of the repository.
    """
    package = Path(__file__).parent
    shipped = package / "_project"
    return shipped if shipped.is_dir() else package.parent


CONF = project_root() / "conf"
GROUPS = ("study", "subject", "variant", "exaggerate")
"""Configuration groups: folders of `conf/`, one file per choice."""
RESERVED = {
    "study": ("benchmark", "stress", "hydra", "report.html"),
    "subject": ("settings", "log", "table", "figures"),
    "variant": ("targets", "truth"),
}
"""Names that are taken in `results/`, in the folder of a study and in that of a gamma."""
MAX_OVERRIDE_BYTES = 30_000
"""Of all overrides together: Linux allows 131072 bytes for the command of a job, in which they are quoted twice."""
MAX_NAME_BYTES = 60
"""Of a study, a subject or a variant: a log file has the names of both in its name, which may have 255 bytes."""
VARIANT_SECTIONS = ("gtstar", "train")
"""Sections that a variant may change."""

MAX_OVERRIDE = 10_000
"""Longest override in characters."""
MAX_BRACKETS = 32
"""Most opening brackets of an override: the time of Hydra's parser grows quickly with their depth."""

_schema = OmegaConf.structured(Config)
# The names of regions come with the head model: here alone keys may be added.
OmegaConf.set_struct(_schema.exaggerate.regions, False)
ConfigStore.instance().store("schema", _schema)


@cache
def compose(*overrides: str) -> DictConfig:
    """Compose and check the settings.

    Args:
        *overrides: Hydra overrides; of two for one key the later wins.

    Returns:
        All settings, interpolations resolved and `mask_flags` combined.

    Raises:
        SettingsError: For unknown keys and choices, wrong types and values out of range, in one line.
        InputError: For a broken file in `conf/`.
    """
    search = [f"hydra.searchpath=['file://{folder.as_posix()}']" for folder in _conf_folders()[1:]]
    _check_overrides(overrides)
    for file in (file for folder in _conf_folders() for file in folder.rglob("*.yaml")):
        check_yaml(file)  # before Hydra opens it
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            config = hydra_compose("config", [*search, *overrides])
            OmegaConf.resolve(config)
    except (HydraException, OmegaConfBaseException, YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise SettingsError(_one_line(error)) from error
    check_section(Config, config)
    config.study.variants = _expand_patterns(config.study.variants)
    _check_names(config)
    combine_mask_flags(config.train)
    return config


def split_overrides(text: str) -> tuple[str, ...]:
    """Split a line of overrides on blanks, with the quotes of a shell.

    Args:
        text: The value of Snakemake's `--config hydra=`.

    Returns:
        The overrides.

    Raises:
        SettingsError: For an open quote.
    """
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        reason = "Snakemake removes a quote at the end of the value; type a blank after it"
        example = "\"hydra=metrics.edit_prompt='A nose' \""
        raise SettingsError(f"hydra={text}: {error}. {reason}, as in --config {example}") from error


def compose_study(*overrides: str) -> DictConfig:
    """Compose what a user asks for; subjects and variants come from the study, so they cannot be overrides.

    Args:
        *overrides: Hydra overrides.

    Returns:
        As `compose`.

    Raises:
        SettingsError: As `compose`, and for overrides of `subject` and `variant`, added and removed keys, and overrides
            that are too long for the command line of a job.
    """
    if (length := sum(len(override.encode()) + 1 for override in overrides)) > MAX_OVERRIDE_BYTES:
        problem = f"the overrides have {length} bytes, more than {MAX_OVERRIDE_BYTES}"
        raise SettingsError(f"{problem}; write them into a file conf/study/NAME.yaml")
    for override in overrides:
        key, _, value = override.partition("=")
        if key in ("subject", "variant"):
            raise SettingsError(f"{override}: a study has several; choose them by study.{key}s=[{value}]")
        if key.startswith(("+", "~")):
            raise SettingsError(f"{override}: keys can be set, neither added nor removed")
    return compose(*overrides)


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


def rendered_levels(config: DictConfig) -> list[str]:
    """The levels at which an avatar is rendered: 0, gamma, and the study's levels between them.

    Args:
        config: Composed settings.

    Returns:
        Levels in ascending order, formatted as in paths.
    """
    inside = {level for level in config.study.levels if level < config.gamma}
    return list(dict.fromkeys(f"{level:g}" for level in sorted({0.0, *inside, config.gamma})))


def target_levels(train: DictConfig, gamma: float) -> list[str]:
    """The levels whose GT* frames training reads: `train.num_gtstar_levels` of them, evenly spaced up to gamma.

    Args:
        train: Composed section `train`.
        gamma: The level that is trained for.

    Returns:
        Levels formatted as in paths. Without GT* supervision gamma alone, if the fitted light is used, or none.
    """
    if train.gtstar_probability == 0:
        return [f"{gamma:g}"] if train.relight_surfels else []
    return [f"{gamma * k / train.num_gtstar_levels:g}" for k in range(1, train.num_gtstar_levels + 1)]


def target_maker(variant: str, *overrides: str) -> str:
    """The first variant with the same settings of `gtstar`: GT* frames are made once, in its name.

    Args:
        variant: Name of the variant that needs GT* frames.
        *overrides: Hydra overrides.

    Returns:
        Name of the variant in whose folder they are.
    """
    needed = compose(*overrides, f"variant={variant}").gtstar
    names = ("alternating", *known("variant"))
    return next(name for name in names if compose(*overrides, f"variant={name}").gtstar == needed)


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
        raise InputError(_one_line(error), file=file) from error
    present = set(_keys(OmegaConf.to_container(found)))
    for key in (key.removeprefix(f"{stage}.") for key, _, _ in walk(schema)):
        if key not in present:  # else a file that was cut off would mean defaults
            raise InputError("this key is missing", file=file, field=key)
    return section


def known(group: str) -> list[str]:
    """The choices of a configuration group.

    Args:
        group: A folder of `conf/`.

    Returns:
        Names of its files, without those that start with an underscore: parts that others share.
    """
    return sorted({file.stem for folder in _conf_folders() for file in (folder / group).glob("[!_]*.yaml")})


def _keys(values: dict[str, Any], at: str = "") -> Iterator[str]:
    """All dotted keys of nested mappings."""
    for name, value in values.items():
        yield f"{at}{name}"
        if isinstance(value, dict):
            yield from _keys(value, f"{at}{name}.")


def _check_overrides(overrides: tuple[str, ...]) -> None:
    """Refuse overrides that Hydra's parser cannot take in reasonable time, and those of Hydra itself."""
    for override in overrides:
        shown = f"{override[:60]}{'...' * (len(override) > 60)}"
        if len(override) > MAX_OVERRIDE:
            raise SettingsError(f"{shown}: {len(override)} characters; at most {MAX_OVERRIDE} are read")
        if sum(override.count(bracket) for bracket in "([{") > MAX_BRACKETS:
            raise SettingsError(f"{shown}: more than {MAX_BRACKETS} brackets")
        if re.match(r"[+~\s]*hydra\b", override):  # such as a search path that imports a package
            raise SettingsError(f"{shown}: settings of Hydra itself cannot be changed")


def _conf_folders() -> list[Path]:
    """The project's `conf` and, if there is another one, that of the current directory; names must not collide."""
    own = Path.cwd() / "conf"
    if not own.is_dir() or own.samefile(CONF):
        return [CONF]
    for group in GROUPS:
        for file in (own / group).glob("*.yaml"):
            shipped = CONF / group / file.name
            if shipped.is_file() and shipped.read_bytes() != file.read_bytes():
                raise SettingsError(f"{file}: {group}={file.stem} comes with carigs; choose another name")
    return [CONF, own]


def _expand_patterns(variants: list[str]) -> list[str]:
    """Replace patterns such as `*_mask` by the variants that match and are not listed themselves."""
    rest = [name for name in known("variant") if name not in variants]
    return [name for v in variants for name in (fnmatch.filter(rest, v) if "*" in v else [v]) or [v]]


def _check_names(config: DictConfig) -> None:
    """Check the names of a study, which depend on the files of `conf/`, and become names of folders."""
    study = config.study
    _check_name("study", "study.name", study.name)
    for group in ("subject", "variant"):
        names = study[f"{group}s"]
        if not names or len(set(names)) < len(names):
            raise SettingsError(f"study.{group}s={list(names)}: expected one or more different names")
        for name in names:
            if name not in known(group):
                raise SettingsError(f"study.{group}s: {name} is unknown; known: {', '.join(known(group))}")
            _check_name(group, f"study.{group}s", name)


def _check_name(group: str, key: str, name: str) -> None:
    marks = "._-" if group == "study" else "_-"
    if not re.fullmatch(rf"\w[\w{marks}]*", name):
        raise SettingsError(f"{key}={name}: letters, digits and {marks} only, not {marks.replace('_', '')} first")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise SettingsError(f"{key}={name}: longer than {MAX_NAME_BYTES} bytes; it becomes a part of names of files")
    if name.lower() in RESERVED[group]:
        raise SettingsError(f"{key}={name}: another folder or file of the results has this name")


def _one_line(error: Exception) -> str:
    """Shorten the reports of Hydra and OmegaConf to one line, and add the known keys or choices."""
    if isinstance(error, MissingConfigException):
        group, _, name = str(error.missing_cfg_file).rpartition("/")
        return f"{group}={name} is unknown; known: {', '.join(known(group))}"
    text = str(error.__cause__ if isinstance(error.__cause__, OmegaConfBaseException) else error)
    detail = r"^\s*(full_key|object_type|reference_type)[:=]\s*(.*)$"
    details = dict(re.findall(detail, text, re.MULTILINE))
    problem = " ".join(re.sub(rf"{detail}|^See https.*$", "", text, flags=re.MULTILINE).split())
    schemas = {"Config": Config, **{schema.__name__: schema for _, schema, _ in walk(Config)}}
    if "Key '" in problem and (schema := schemas.get(details.get("object_type", ""))):
        problem += f"; known: {', '.join(schema.__dataclass_fields__)}"
    problem = problem.replace("add --multirun to your command line", "use `carigs sweep`")
    where = details.get("full_key") or getattr(error, "override", None)
    return f"{where}: {problem}" if where else problem
