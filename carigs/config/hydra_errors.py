"""Errors of Hydra and OmegaConf as messages of one line."""

from __future__ import annotations

import re

from hydra.errors import HydraException, MissingConfigException
from omegaconf.errors import OmegaConfBaseException

from carigs.config.conf_files import choices
from carigs.settings import Config
from carigs.settings.option import walk


def describe(error: Exception) -> str:
    """Shorten an error to one line, and add the known keys or choices.

    Args:
        error: Raised by Hydra or OmegaConf.

    Returns:
        The line; it starts with the key or override if the error has one.
    """
    if isinstance(error, MissingConfigException):
        group, _, name = str(error.missing_cfg_file).partition("/")
        return f"{group}={name} is unknown; known: {choices(group)}"
    # Hydra leaves out the details. An error of OmegaConf has a cause, which lacks them, while a debugger is attached.
    by_hydra = isinstance(error, HydraException) and isinstance(error.__cause__, OmegaConfBaseException)
    text = str(error.__cause__ if by_hydra else error)
    detail = r"^\s*(full_key|object_type|reference_type)[:=]\s*(.*)$"
    details = dict(re.findall(detail, text, re.MULTILINE))
    problem = " ".join(re.sub(rf"{detail}|^See https.*$", "", text, flags=re.MULTILINE).split())
    schemas = {"Config": Config, **{schema.__name__: schema for _, schema, _ in walk(Config)}}
    if "Key '" in problem and (schema := schemas.get(details.get("object_type", ""))):
        problem += f"; known: {', '.join(schema.__dataclass_fields__)}"
    where = details.get("full_key") or getattr(error, "override", None)
    return f"{where}: {problem}" if where else problem
