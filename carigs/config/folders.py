"""Where the configuration is: the folder of the project, and the folders `conf` with their groups."""

from __future__ import annotations

import os
import re
from pathlib import Path

from carigs.config.mask_variants import MASK_VARIANTS
from carigs.errors import SettingsError
from carigs.readers.folders import listed


def project_root() -> Path:
    """The folder with `Snakefile`, `conf`, `workflow` and `profiles`.

    Returns:
        `carigs/_project` of an installed package, else the root of the repository.
    """
    package = Path(__file__).parents[1]
    shipped = package / "_project"
    return shipped if shipped.is_dir() else package.parent


CONF = project_root() / "conf"
GROUPS = ("study", "preset", "subject", "variant", "exaggerate")
"""Configuration groups: folders of `conf/`, one file per choice."""


def conf_folders() -> list[Path]:
    """The project's `conf` and, if there is another one, that of the current directory.

    Returns:
        One or two folders.
    """
    own = Path.cwd() / "conf"
    return [CONF, own] if own.is_dir() and not own.samefile(CONF) else [CONF]


def find_conf_file(name: str) -> Path | None:
    """Find a file of the configuration.

    Args:
        name: Its name without suffix, relative to `conf`: `study/toy`.

    Returns:
        The file; None if there is none, or if the name leads to a hidden file or out of `conf`.

    Raises:
        SettingsError: If a choice of a group in the current directory has the name of another one of the project.
    """
    if not all(map(_is_shown, re.split(r"[/\\]", name))):
        return None
    files = [folder / f"{name}.yaml" for folder in conf_folders()]
    found = [file for file in files if os.path.lexists(file)]
    if "/" in name and len(found) == 2 and found[0].read_bytes() != found[1].read_bytes():
        raise taken(name, found[1])
    return found[0] if found else None


def taken(name: str, file: Path) -> SettingsError:
    """The error of a file that has the name of a choice of the project.

    Args:
        name: Group and name of the choice.
        file: The file.

    Returns:
        The error, to be raised.
    """
    group, _, choice = name.rpartition("/")
    return SettingsError(f"{file}: {group}={choice} comes with carigs; choose another name")


def is_choice(name: str) -> bool:
    """Whether a name may be chosen in a configuration group.

    Args:
        name: Name of a file without suffix, or of one in a folder of the group.

    Returns:
        Whether it leads to a file of the group that is neither hidden nor a part that others share.
    """
    return all(_is_shown(part) and not part.startswith("_") for part in re.split(r"[/\\]", name))


def _is_shown(part: str) -> bool:
    return part != "" and not part.startswith(".")


def known(group: str) -> list[str]:
    """The choices of a configuration group.

    Args:
        group: A folder of `conf/`.

    Returns:
        Names of its files, without those that start with an underscore: parts that others share; of variants also those
        with and without a mask flag.
    """
    files = (file for folder in conf_folders() for file in listed(folder / group, "*.yaml"))
    made = MASK_VARIANTS if group == "variant" else ()
    return sorted({*made, *(file.stem for file in files if is_choice(file.stem))})
