"""Where the configuration is: the folder of the project, and the folders `conf` with their groups."""

from __future__ import annotations

from pathlib import Path

from carigs.errors import InputError, SettingsError
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

    Raises:
        SettingsError: If a file of the current directory has the name of another one of the project.
    """
    own = Path.cwd() / "conf"
    if not own.is_dir() or own.samefile(CONF):
        return [CONF]
    for group in GROUPS:
        for file in listed(own / group, "*.yaml"):
            shipped = CONF / group / file.name
            if shipped.is_file() and shipped.read_bytes() != file.read_bytes():
                raise SettingsError(f"{file}: {group}={file.stem} comes with carigs; choose another name")
    return [CONF, own]


def check_package(file: Path) -> None:
    """Refuse a study, preset, subject or variant whose keys Hydra would put below the name of the group.

    Args:
        file: File of a configuration group, which has passed `check_yaml`.

    Raises:
        InputError: If there is no comment with Hydra's `@package`.
    """
    if file.parent.name in ("study", "preset", "subject", "variant") and "@package" not in file.read_text("utf-8"):
        raise InputError("its first line must be `# @package _global_`", file=file)


def known(group: str) -> list[str]:
    """The choices of a configuration group.

    Args:
        group: A folder of `conf/`.

    Returns:
        Names of its files, without those that start with an underscore: parts that others share.
    """
    return sorted({file.stem for folder in conf_folders() for file in listed(folder / group, "[!_]*.yaml")})
