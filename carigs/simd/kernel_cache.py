"""The folder in which Numba keeps compiled kernels: one for each version of Numba and state of the kernels' sources.

Numba checks only the file that a kernel is written in. After an edit of a function or constant that the kernel takes
from another module (or a `git pull`), it would load the old machine code. Kernels of another version of Numba it
replaces without notice: two environments with the same sources would compile each other's away.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib.metadata import version
from pathlib import Path

from filelock import FileLock

PACKAGE = Path(__file__).parents[1]
KERNEL_MARKS = (b"numba", b"carigs.simd")
"""Texts that the source of every kernel contains at least one of."""
KEEP = 7 * 24 * 3600.0
"""Seconds after which the folder of other sources is removed; runs of those sources may still be active before."""
_IMPORT = re.compile(
    rb"^\s*(?:from\s+(carigs[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+(carigs[\w.]*))", re.MULTILINE
)


def use_kernel_cache() -> Path:
    """Point Numba to the folder of its version and the present sources, and remove old folders.

    The folder lies in the one that the environment variable NUMBA_CACHE_DIR names, if it is set, otherwise in the
    package, or in ~/.cache/carigs if the package cannot be written to.

    Returns:
        The folder, which need not exist yet.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        base = Path(os.environ["NUMBA_CACHE_DIR"])
        base = base.parent if base.name.startswith("kernels-") else base  # set by a parent process
    else:
        base = (PACKAGE if os.access(PACKAGE, os.W_OK) else Path.home() / ".cache" / "carigs") / "__pycache__"
    folder = base / f"kernels-{_digest()}"
    for other in base.glob("kernels-*"):
        if other != folder and time.time() - other.stat().st_mtime > KEEP:
            shutil.rmtree(other, ignore_errors=True)
    # Numba reads the variable when it is first imported.
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return folder


def _digest() -> str:
    """Digest of the modules that hold kernels and of all modules of this package that they import.

    Bytes are compared, and imports are found by a regular expression, unlike in `carigs.sources.fingerprint`: this
    function runs at every start, and parsing takes longer.
    """
    texts = {file: file.read_bytes() for file in PACKAGE.rglob("*.py")}
    pending = [file for file, text in texts.items() if any(mark in text for mark in KERNEL_MARKS)]
    needed: set[Path] = set()
    while pending:
        file = pending.pop()
        if file not in needed:
            needed.add(file)
            pending += _imports(texts[file], texts)
    digest = hashlib.sha256(f"{version('numba')} {os.environ.get('CARIGS_PLAIN_NUMBA', '')}".encode())
    for file in sorted(needed):
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + texts[file] + b"\0")
    return digest.hexdigest()[:16]


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
    import numba

    if not numba.config.CACHE_DIR:  # the environment was replaced after `use_kernel_cache`; Numba reads it again
        use_kernel_cache()
    folder = Path(numba.config.CACHE_DIR)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / f"{name}.lock").acquire()
    except (OSError, NotImplementedError):  # the folder is read-only, or its file system has no locks
        lock = nullcontext()
    with lock:
        yield


def kernels_are_compiled(folder: Path) -> bool:
    """Whether a cache has the kernel of forward compositing, and then most likely all that a training needs.

    Args:
        folder: Folder of compiled kernels.

    Returns:
        False for an empty cache.
    """
    return any(folder.rglob("forward_simd.*.nbi"))


def announce_compilation() -> None:
    """Print one line to stderr if the rasteriser's kernels are not cached: the first step will seem to hang."""
    import numba

    folder = Path(numba.config.CACHE_DIR)
    if not kernels_are_compiled(folder):
        print(f"carigs: compiling kernels into {folder} (once, 15 to 60 seconds)", file=sys.stderr)
