"""Where Numba keeps compiled kernels: a folder per state of all kernels' sources.

Numba looks only at the file that a kernel is written in: after an edit of a formula that it calls from another module
(or a `git pull` of one) it would go on with the old machine code.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from filelock import FileLock

PACKAGE = Path(__file__).parents[1]
MARKS = (b"numba", b"carigs.simd.kernels", b"carigs.simd")
"""What the sources of kernels contain."""
KEEP = 7 * 24 * 3600.0
"""Seconds since its last change for which the folder of other sources stays: a run with those may still go on."""


def use_kernel_cache() -> Path:
    """Point Numba to the folder of the present sources and remove old ones; NUMBA_CACHE_DIR, if set, has its way."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return Path(os.environ["NUMBA_CACHE_DIR"])
    digest = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        source = file.read_bytes()
        if any(mark in source for mark in MARKS):
            digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + source + b"\0")
    writable = os.access(PACKAGE, os.W_OK)
    base = (PACKAGE if writable else Path.home() / ".cache" / "carigs") / "__pycache__"
    folder = base / f"kernels-{digest.hexdigest()[:16]}"
    for other in base.glob("kernels-*"):
        if other != folder and time.time() - other.stat().st_mtime > KEEP:
            shutil.rmtree(other, ignore_errors=True)
    # Numba reads the variable when it is first imported.
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return folder


@contextmanager
def kernel_lock(name: str) -> Iterator[None]:
    """Only one process at a time is within, of those that share the folder; ended processes, however, hold nothing.

    Without effect where files cannot be written or locked: kernels are then compiled by each process.
    """
    import numba

    folder = Path(numba.config.CACHE_DIR)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / f"{name}.lock").acquire()
    except (OSError, NotImplementedError):  # of a folder that is read-only, or on a file system without locks
        lock = nullcontext()
    with lock:
        yield


def announce_compilation() -> None:
    """One line on stderr if the engine's kernels are not in the cache: the first step will seem to hang."""
    import numba

    folder = Path(numba.config.CACHE_DIR)
    if not any(folder.rglob("forward_simd.*.nbi")):
        print(f"carigs: compiling kernels for this processor into {folder}: once, 15 to 60 seconds", file=sys.stderr)
