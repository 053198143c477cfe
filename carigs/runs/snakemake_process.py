"""What Snakemake needs, and ends with a traceback without: folders that take files, and the name of the user."""

from __future__ import annotations

import getpass
import os
from collections.abc import Iterable
from pathlib import Path

from carigs.errors import InputError
from carigs.system.cache_folders import cache_homes, can_be_made, first_usable, user_cache

STATE = Path(".snakemake")
"""Folder of its state, in the current directory."""


def check_working_folder(results: Iterable[Path] = ()) -> None:
    """Refuse to start Snakemake where it cannot write.

    Args:
        results: Further folders, relative to the current directory, that are to be written to; they need not exist.

    Raises:
        InputError: The current directory or one of the folders cannot be written to.
    """
    for folder in (STATE, *results):
        folder = folder.absolute()
        if not can_be_made(folder):
            existing = next((place for place in (folder, *folder.parents) if os.path.exists(place)), folder)
            what = "Snakemake keeps its state" if folder.name == STATE.name else "a run writes its results"
            raise InputError(f"cannot be written to, and {what} there; work in another folder", file=existing)


def snakemake_environment() -> dict[str, str]:
    """The environment of a Snakemake process.

    Returns:
        The variables of this process. Where the user's cache cannot be written to, XDG_CACHE_HOME names a folder that
        can, and TORCH_HOME and HF_HOME the old places of weights, which jobs read. A user without a home has that
        folder as XDG_CONFIG_HOME, too, a user without a name the number as LOGNAME.
    """
    environment, own = dict(os.environ), user_cache()
    if own is None or not can_be_made(own / "snakemake"):
        folder, _ = first_usable(home / "snakemake" for home in (*cache_homes(), STATE.absolute() / "cache"))
        if folder:
            environment["XDG_CACHE_HOME"] = str(folder.parent)
        if own:
            environment = {"TORCH_HOME": str(own / "torch"), "HF_HOME": str(own / "huggingface")} | environment
    if not os.path.isabs(os.path.expanduser("~")) and "XDG_CACHE_HOME" in environment:
        environment.setdefault("XDG_CONFIG_HOME", environment["XDG_CACHE_HOME"])  # where it looks for profiles
    try:
        getpass.getuser()
    except (KeyError, OSError):  # no such user: the process runs under a number
        environment["LOGNAME"] = str(os.getuid())
    return environment
