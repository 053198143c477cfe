"""Compiled kernels on disk: a file for each signature, with a digest of its content.

Numba's own cache runs whatever it finds: a file that is cut, or of which a bit has changed, ends every later process
with a traceback or with wrong machine code. Here a file counts only if its digest is right; otherwise the kernel is
compiled again. Files are written under another name first, so that processes that write at once do no harm.
"""

from __future__ import annotations

import inspect
import pickle
import re
import shutil
import warnings
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

from numba.core.base import BaseContext
from numba.core.codegen import Codegen
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from carigs.errors import CarigsWarning
from carigs.simd.kernel_cache import PACKAGE, is_covered, kernel_folder, package_digest
from carigs.system.files import writing

SEAL_BYTES = sha256().digest_size


class KernelFiles:
    """The cache of one kernel, with the methods that Numba's dispatchers call (`numba.core.caching.Cache`)."""

    def __init__(self, function: Callable) -> None:
        """Prepare the cache; no file is touched.

        Args:
            function: The kernel's Python function.
        """
        self._function = function
        file = Path(inspect.getfile(function))
        self._is_kept = is_covered(file) or not file.is_relative_to(PACKAGE)  # else no edit would be seen
        self._around = "" if is_covered(file) else package_digest()  # now, when the sources are imported
        self.name = re.sub(r"[^\w.]", "", f"{function.__module__}.{function.__qualname__}")

    @property
    def cache_path(self) -> str:
        """The folder, as Numba's statistics name it.

        Returns:
            Its path; empty if nothing is kept.
        """
        return str(kernel_folder() or "")

    def load_overload(self, signature: object, target_context: BaseContext) -> CompileResult | None:
        """Load the kernel of a signature.

        Args:
            signature: Types of the arguments.
            target_context: What it is compiled for.

        Returns:
            The compiled kernel; None if it has to be compiled.
        """
        target_context.refresh()
        file = self._file(signature, target_context.codegen())
        content = _sound_content(file) if file else None
        if content is None:
            return None
        compiled_for, parts = pickle.loads(content)
        return CompileResult._rebuild(target_context, *parts) if compiled_for == signature else None

    def save_overload(self, signature: object, result: CompileResult) -> None:
        """Keep a compiled kernel. Where that fails, a warning says so, once.

        Args:
            signature: Types of the arguments.
            result: The compiled kernel.
        """
        file = self._file(signature, result.codegen)
        if file is None or result.library.has_dynamic_globals or not all(part.can_cache for part in result.lifted):
            return
        content = dumps((signature, result._reduce()))
        try:
            if file.is_dir():
                shutil.rmtree(file)
            with writing(file) as part:
                part.write_bytes(_seal(file, content) + content)
        except OSError as error:
            _warn_once(file.parent, error.strerror or str(error))

    def flush(self) -> None:
        """Remove what is kept of this kernel."""
        if folder := kernel_folder():
            for file in folder.glob(f"{self.name}.*.kernel"):
                file.unlink(missing_ok=True)

    def _file(self, signature: object, codegen: Codegen) -> Path | None:
        """The file of a signature: named after all that the machine code depends on, besides the folder's sources."""
        folder, source = kernel_folder(), _source_digest(inspect.getfile(self._function))
        if folder is None or source is None or not self._is_kept or self._function.__closure__:
            return None  # no digest is known of all that it is compiled from
        line = self._function.__code__.co_firstlineno
        key = (str(signature), codegen.magic_tuple(), source, self._around, line)
        return folder / f"{self.name}.{sha256(repr(key).encode()).hexdigest()[:16]}.kernel"


def _sound_content(file: Path) -> bytes | None:
    """What was written to a file; None if it is not there, cannot be read, or is damaged."""
    try:
        content = file.read_bytes() if file.is_file() else b""  # no bytes of a pipe, for which one would wait
    except OSError:
        return None
    seal, content = content[:SEAL_BYTES], content[SEAL_BYTES:]
    return content if _seal(file, content) == seal else None


def _seal(file: Path, content: bytes) -> bytes:
    """Digest of a file's content and name: that of another kernel would not do."""
    return sha256(file.name.encode() + b"\0" + content).digest()


@cache
def _source_digest(file: str) -> str | None:
    """Digest of a source file; None if there is none, as for code that was typed in."""
    try:
        return sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return None


@cache
def _warn_once(folder: Path, problem: str) -> None:
    warnings.warn(
        CarigsWarning(f"{folder}: compiled kernels cannot be kept ({problem}); each process compiles its own"),
        stacklevel=2,
    )
