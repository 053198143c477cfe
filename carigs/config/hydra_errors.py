"""Errors of Hydra and OmegaConf as messages of one line."""

from __future__ import annotations

import re

from hydra.errors import HydraException, MissingConfigException
from omegaconf.errors import OmegaConfBaseException

from carigs.config.conf_files import choices
from carigs.config.unknown_keys import no_such_setting


def describe(error: Exception, section: str = "") -> str:
    """Shorten an error to one line, and add the nearest key or the known choices.

    Args:
        error: Raised by Hydra or OmegaConf.
        section: Name of the section, if the settings were that section alone.

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
    where = details.get("full_key") or getattr(error, "override", None)
    if where and re.search(r"Key '.*' (is )?not in", problem):
        typed = re.search(r"Could not override '([\w.]+)'", str(error))
        key = typed[1] if typed and typed[1].startswith(where) else f"{section}.{where}".lstrip(".")
        file = re.match(r"In '(\w+/[^']+)'", str(error))
        return f"conf/{file[1]}.yaml: {no_such_setting(key)}" if file else no_such_setting(key)
    return f"{where}: {problem}" if where else problem
