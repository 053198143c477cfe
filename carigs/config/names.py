"""Names of studies, subjects and variants, and seeds, which become folders of the results."""

from __future__ import annotations

import fnmatch
import re

from omegaconf import DictConfig

from carigs.config.conf_files import choices
from carigs.config.folders import known
from carigs.errors import SettingsError

RESERVED = {
    "study": ("benchmark", "stress", "hydra"),
    "subject": ("settings", "log", "table", "figures", "embeddings"),
    "variant": ("targets", "truth"),
}
"""Names that are taken in `results/`, in the folder of a study and in that of a gamma."""
MAX_NAME_BYTES = 60
"""Of a study, a subject or a variant: a log file has the names of both in its name, which may have 255 bytes."""


def expand_patterns(variants: list[str]) -> list[str]:
    """Replace patterns such as `*_mask`.

    Args:
        variants: Names and patterns.

    Returns:
        Names; for a pattern the variants that match and are not listed themselves, or the pattern if none does.
    """
    rest = [name for name in known("variant") if name not in variants]
    return [name for v in variants for name in (fnmatch.filter(rest, v) if "*" in v else [v]) or [v]]


def check_names(config: DictConfig) -> None:
    """Check the names and seeds of a study. Names depend on the files of `conf/`, and become names of folders.

    Args:
        config: Composed settings.

    Raises:
        SettingsError: For the first name or seed that is repeated, and the first name that is unknown or cannot be a
            folder's; for a variant to compare with that is unknown.
    """
    study = config.study
    _check_name("study", "study.name", study.name)
    for group in ("subject", "variant"):
        names = study[f"{group}s"]
        if not names or len(set(names)) < len(names):
            raise SettingsError(f"study.{group}s={list(names)}: expected one or more different names")
        for name in names:
            if name not in known(group):
                raise SettingsError(f"study.{group}s: {name} is unknown; known: {choices(group)}")
            _check_name(group, f"study.{group}s", name)
    if config.tabulate.reference not in known("variant"):
        problem = f"is no variant; known: {choices('variant')}"
        raise SettingsError(f"tabulate.reference={config.tabulate.reference} {problem}")
    if not study.seeds or len(set(study.seeds)) < len(study.seeds):
        raise SettingsError(f"study.seeds={list(study.seeds)}: expected one or more different seeds")


def _check_name(group: str, key: str, name: str) -> None:
    marks = "._-" if group == "study" else "_-"
    if not re.fullmatch(rf"\w[\w{marks}]*", name):
        raise SettingsError(f"{key}={name}: letters, digits and {marks} only, not {marks.replace('_', '')} first")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise SettingsError(f"{key}={name}: longer than {MAX_NAME_BYTES} bytes; it becomes a part of names of files")
    if name.lower() in RESERVED[group]:
        raise SettingsError(f"{key}={name}: another folder or file of the results has this name")
