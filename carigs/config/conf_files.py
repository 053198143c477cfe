"""Files of `conf/` as Hydra reads them: through a source of its own, which checks each one when a choice needs it.

A file that is broken so hinders nobody who chooses another one.
"""

from __future__ import annotations

import os
import pickle
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from omegaconf import OmegaConf

from carigs.config.file_values import check_values
from carigs.config.folders import conf_folders, find_conf_file, known, taken
from carigs.config.mask_variants import mask_variant
from carigs.errors import CarigsError, InputError
from carigs.readers.yaml_files import read_yaml_text

SEARCH_PATH = "carigs://conf"
"""Where Hydra finds what `find_conf_file` finds."""
GLOBAL_GROUPS = ("study", "preset", "subject", "variant")
"""Groups whose files have keys of several sections; that of another group has the keys of its own section."""


class _ConfFiles(ConfigSource):
    """Hydra's source of the files in `conf_folders`."""

    @staticmethod
    def scheme() -> str:
        """Scheme of the search path."""
        return "carigs"

    def load_config(self, config_path: str) -> ConfigResult:
        """Read and check a file; Hydra's reader would stop at `%YAML` and `---` before it finds the package."""
        found = read_choice(config_path.removesuffix(".yaml"))
        if found is None:
            raise ConfigLoadError(f"no such file: {config_path}")
        config = pickle.loads(_parsed(found.text))
        return ConfigResult(self.provider, self.full_path(), config, {"package": found.package})

    def available(self) -> bool:
        """Whether there are files."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether a name is that of a folder."""
        return any(os.path.isdir(folder / config_path) for folder in conf_folders())

    def is_config(self, config_path: str) -> bool:
        """Whether a name is that of a file, or of a variant that is made from a mask flag."""
        name = config_path.removesuffix(".yaml")
        _asked.add(name)
        return mask_variant(name) is not None or find_conf_file(name) is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The choices of a group."""
        return [] if results_filter == ObjectType.GROUP else known(config_path)


Plugins.instance().register(_ConfFiles)
_asked: set[str] = set()


@contextmanager
def names_asked() -> Iterator[set[str]]:
    """Note the names that Hydra asks for.

    Yields:
        The names, complete at the end of the block: also those of files that are not there.
    """
    _asked.clear()
    yield _asked


class ConfFile(NamedTuple):
    """A file that has passed all checks."""

    text: str
    package: str | None
    """Where its keys belong, as its comment `# @package` says."""


def read_choice(name: str) -> ConfFile | None:
    """Read and check a choice of a group.

    Args:
        name: Its group and name: `study/toy`.

    Returns:
        Its file, or what the file of a variant with or without a mask flag would be; None if there is none.

    Raises:
        SettingsError: As for `find_conf_file`, also for the name of such a variant.
        InputError: As for `read_conf_file`.
    """
    file, made = find_conf_file(name), mask_variant(name)
    if made is None:
        return read_conf_file(file) if file else None
    if file and file.read_text("utf-8", "replace") != made:
        raise taken(name, file)
    return ConfFile(made, "_global_")


def read_conf_file(file: Path) -> ConfFile:
    """Read a file of `conf/` and check it.

    Args:
        file: The file.

    Returns:
        Its text and package; a file that has not changed since is not read again.

    Raises:
        InputError: As for `read_yaml_text` and `check_values`; if a study, preset, subject or variant has no package:
            Hydra would put its keys below the name of the group.
    """
    status = file.stat() if file.exists() else None
    return _read(file, *((status.st_mtime_ns, status.st_size, status.st_ino) if status else ()))


def choices(group: str) -> str:
    """The choices of a configuration group, for messages.

    Args:
        group: A folder of `conf/`.

    Returns:
        Names, and what is wrong with the files that cannot be chosen.
    """
    sound, broken = [], []
    for name in known(group):
        try:
            read_choice(f"{group}/{name}")
            sound.append(name)
        except CarigsError as error:
            broken.append(f"; {name} is broken ({error})")
    return f"{', '.join(sound)}{''.join(broken)}"


@lru_cache(maxsize=4096)
def _parsed(text: str) -> bytes:
    """The text as Hydra needs it, pickled: Hydra changes what it gets, and a copy takes less time than parsing."""
    return pickle.dumps(OmegaConf.create(text))


@lru_cache(maxsize=4096)
def _read(file: Path, *_: int) -> ConfFile:
    text = read_yaml_text(file)
    package = _package(text)
    if package is None and file.parent.name in GLOBAL_GROUPS:
        raise InputError("its first line must be `# @package _global_`", file=file)
    check_values(text, file)
    return ConfFile(text, package)


def _package(text: str) -> str | None:
    """What a comment before the first key says after `@package`."""
    for line in map(str.strip, text.splitlines()):
        if found := re.fullmatch(r"#\s*@package\s+(\S+)", line):
            return found[1]
        if line and not line.startswith(("#", "%")) and not re.match(r"---(\s*#|$)", line):
            return None
    return None
