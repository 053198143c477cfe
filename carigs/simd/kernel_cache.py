"""The folder that keeps compiled kernels: one for each version of Numba and state of the kernels' sources.

The name of the folder has a digest of all that kernels are compiled from. After an edit of a function or constant that
a kernel takes from another module (or a `git pull`), and with another version of Numba, kernels lie in another folder.
An edit of settings, of a stage, or of anything else that no module with kernels imports leaves them where they are.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from importlib.metadata import version
from itertools import chain
from pathlib import Path

from filelock import FileLock

from carigs.errors import CarigsWarning, print_line
from carigs.system.cache_folders import FOREIGN, OPEN, cache_folders, first_usable

PACKAGE = Path(__file__).parents[1]
_COMPILES = re.compile(
    rb"^\s*(?:from|import)\s+(?:numba\b|carigs\.simd\b(?!\.(?:threads|kernel_cache)\b))", re.MULTILINE
)
"""An import of what compiles functions: modules with kernels, or with functions that only kernels call, have one."""
KEEP = 7 * 24 * 3600.0
"""Seconds after which the folder of other sources is removed; runs of those sources may still be active before."""
_IMPORT = re.compile(
    rb"^\s*(?:from\s+(carigs[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+(carigs[\w.]*))", re.MULTILINE
)


@cache
def kernel_folder() -> Path | None:
    """Find the folder for the kernels of this process, create it, and remove those of other sources.

    It lies in the folder that the environment variable NUMBA_CACHE_DIR names. Without the variable, or where that one
    cannot be used, it lies in the package, in the user's cache, or among temporary files.

    Returns:
        The folder; None if there is none that this user can write to and that nobody else can change.
    """
    chosen, name = os.environ.get("NUMBA_CACHE_DIR"), f"kernels-{sources_digest()}"
    bases = [Path(chosen).absolute()] if chosen else []
    candidates = (base / name for base in chain(bases, [PACKAGE / "__pycache__"], cache_folders("__pycache__")))
    # Who owns the package can change its code: kernels of theirs may run as well.
    folder, problems = first_usable(candidates, owners=[PACKAGE.stat().st_uid])
    for refused, problem in problems.items():
        if refused.parent in bases or problem in (FOREIGN, OPEN):
            name = f"NUMBA_CACHE_DIR={chosen}" if refused.parent in bases else refused
            _warn(f"{name}: not used for compiled kernels: {problem}" + (f"; {folder} is" if folder else ""))
    if folder is None:
        _warn("no folder can keep compiled kernels, so that each process compiles its own; set NUMBA_CACHE_DIR to one")
    else:
        _remove_others(folder)
    return folder


def _warn(message: str) -> None:
    warnings.warn(CarigsWarning(message), stacklevel=3)


def _remove_others(folder: Path) -> None:
    """Remove the folders of kernels of other sources that nobody has used for a while."""
    for other in folder.parent.glob(f"kernels-{'[0-9a-f]' * 16}"):
        with suppress(OSError):  # another process removes it as well
            if other != folder and time.time() - other.stat().st_mtime > KEEP:
                shutil.rmtree(other, ignore_errors=True)


def is_covered(file: Path) -> bool:
    """Whether an edit of a module of this package changes the folder.

    Args:
        file: Its path.

    Returns:
        Whether it is one of the modules of `sources_digest`.
    """
    return file in _covered()


@cache
def package_digest() -> str:
    """Digest of all modules of this package: for kernels outside of it, which may take anything from it.

    Returns:
        Sixteen hexadecimal digits; those of the first call, as long as the process lives.
    """
    return _digest(_texts())


@cache
def sources_digest() -> str:
    """Digest of the modules that compile functions, all modules of this package that they import, and of the compiler.

    Bytes are compared, and imports are found by a regular expression, unlike in `carigs.runs.sources.fingerprint`: this
    function runs at every start, and parsing takes longer.

    Returns:
        Sixteen hexadecimal digits; those of the first call, as long as the process lives.
    """
    return _digest(_covered())


def _digest(texts: Mapping[Path, bytes]) -> str:
    compiler = (version("numba"), sys.implementation.cache_tag, os.environ.get("CARIGS_PLAIN_NUMBA", ""))
    digest = hashlib.sha256(repr(compiler).encode())
    for file in sorted(texts):
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + texts[file] + b"\0")
    return digest.hexdigest()[:16]


def _texts() -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in PACKAGE.rglob("*.py")}


@cache
def _covered() -> dict[Path, bytes]:
    texts = _texts()
    pending = [file for file, text in texts.items() if _COMPILES.search(text)]
    needed: dict[Path, bytes] = {}
    while pending:
        file = pending.pop()
        if file not in needed:
            needed[file] = texts[file]
            pending += _imports(texts[file], texts)
    return needed


def _imports(text: bytes, texts: dict[Path, bytes]) -> Iterator[Path]:
    """Files of the package that a module imports: `from a.b import c` is `a/b/c.py`, `a/b.py` or `a/b/__init__.py`."""
    for origin, names, module in _IMPORT.findall(text):
        path = PACKAGE.joinpath(*(origin or module).decode().split(".")[1:])
        for candidate in (path, *(path / name.decode() for name in re.findall(rb"\w+", names))):
            for file in (candidate.with_name(f"{candidate.name}.py"), candidate / "__init__.py"):
                if file in texts:
                    yield file


@contextmanager
def kernel_lock(name: str) -> Iterator[None]:
    """Lock between processes that share the cache folder; released when its holder exits, however it exits.

    It has no effect where files cannot be written or locked. Each process then compiles its own kernels.

    Args:
        name: Name of the lock.

    Yields:
        None, while the lock is held.
    """
    folder, lock = kernel_folder(), nullcontext()
    if folder:
        with suppress(OSError, NotImplementedError):  # the disk is full, or the file system has no locks
            lock = FileLock(folder / f"{name}.lock").acquire()
    with lock:
        yield


def kernels_are_compiled() -> bool:
    """Whether the cache has the kernel of forward compositing, and then most likely all that a training needs.

    Returns:
        False for an empty cache, and without one.
    """
    folder = kernel_folder()
    return folder is not None and any(folder.glob("*forward_simd.*.kernel"))


def announce_compilation() -> None:
    """Print one line to stderr if the rasteriser's kernels are not cached: the first step will seem to hang."""
    if not kernels_are_compiled():
        where = f" into {kernel_folder()} (once, 15 to 60 seconds)" if kernel_folder() else " (15 to 60 seconds)"
        print_line(f"compiling kernels{where}")
