"""Folders for what can be made again: the first one that takes files, and that nobody but this user can change.

A cache holds results that are believed, and kernels, which are code that runs. So a folder that another user owns or
can write to is not used, not even to read what is there. Without any folder, programs work and keep nothing.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

ONLY_OWNER_WRITES = 0o755
"""Permissions of new folders, also where the umask would let others write."""
FOREIGN, OPEN = "it belongs to another user", "others can write to it; remove it"
"""Why a folder is not used although it takes files."""


def user_cache() -> Path | None:
    """Where the programs of this user keep caches: `$XDG_CACHE_HOME` if it is an absolute path, else `~/.cache`.

    Returns:
        The folder, which need not exist; None for a user without a home folder.
    """
    chosen, home = os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~")
    if os.path.isabs(chosen):
        return Path(chosen)
    return Path(home, ".cache") if os.path.isabs(home) and os.path.isdir(home) else None


def cache_homes() -> Iterator[Path]:
    """Folders for the caches of all programs, the preferred one first; they need not exist.

    Yields:
        The user's cache, and a folder of this user among temporary files.
    """
    if cache := user_cache():
        yield cache
    try:
        temporary = Path(tempfile.gettempdir())
    except OSError:  # no folder takes temporary files
        return
    if temporary != Path.cwd():  # which Python takes where there is no other: no place for a cache
        yield temporary / (f"carigs-{os.getuid()}" if hasattr(os, "getuid") else "carigs")


def cache_folders(name: str) -> Iterator[Path]:
    """Folders for a cache of carigs, the preferred one first; they need not exist.

    Args:
        name: Name of the cache.

    Yields:
        `carigs/NAME` in each of `cache_homes`.
    """
    for home in cache_homes():
        yield home / "carigs" / name


def first_usable(folders: Iterable[Path], owners: Collection[int] = ()) -> tuple[Path | None, dict[Path, str]]:
    """Create the first folder that can be a cache.

    Args:
        folders: Folders to try; none is looked at after the first that can be used.
        owners: Ids of users who may own the folder, besides this one and root.

    Returns:
        The folder, None if there is none; and why each folder before it cannot be used.
    """
    problems: dict[Path, str] = {}
    for folder in folders:
        problem = _problem(folder, owners)
        if problem is None:
            return folder, problems
        problems[folder] = problem
    return None, problems


def find_cache_of_matplotlib() -> None:
    """Name a cache folder for Matplotlib where neither the user nor Matplotlib has one.

    Otherwise Matplotlib makes a new folder for each process, and says so in two lines.
    """
    own = (Path(os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~/.config")), user_cache())
    if "MPLCONFIGDIR" not in os.environ and not all(folder and can_be_made(folder) for folder in own):
        folder, _ = first_usable(home / "matplotlib" for home in cache_homes())
        if folder:
            os.environ["MPLCONFIGDIR"] = str(folder)


def can_be_made(folder: Path) -> bool:
    """Whether this user can create a folder, or files in one that exists; nothing is created.

    Args:
        folder: Its absolute path.

    Returns:
        False also for a relative path, and if a part of it is a file or cannot be looked at.
    """
    if not folder.is_absolute():
        return False
    try:
        existing = next(place for place in (folder, *folder.parents) if place.exists())
        return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
    except OSError:
        return False


def _problem(folder: Path, owners: Collection[int]) -> str | None:
    """Why a folder cannot be a cache; None if it can, and then it exists."""
    try:
        folder.mkdir(mode=ONLY_OWNER_WRITES, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        return error.strerror or str(error)
    if hasattr(os, "getuid"):
        if status.st_uid not in (os.getuid(), 0, *owners):
            return FOREIGN
        others = stat.S_IWOTH if status.st_gid == os.getgid() else stat.S_IWOTH | stat.S_IWGRP
        if status.st_mode & others:
            return OPEN
    return None if os.access(folder, os.W_OK | os.X_OK) else "it cannot be written to"
