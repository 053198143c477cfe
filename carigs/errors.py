"""Errors that a user can cause, and their lines. Every one says what is wrong, where, and what to do about it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def printable(text: str) -> str:
    """Make a text that may quote names from a file one line that a terminal shows as it is.

    Args:
        text: The text.

    Returns:
        The text with escapes for characters that are not printable, such as line breaks and the control characters of
        terminals.
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class CarigsError(Exception):
    """Base class of the errors caused by inputs or settings; printed as one line without a traceback."""

    def __init__(self, message: str) -> None:
        """Keep the message in one line.

        Args:
            message: The message. It may quote names from a file: characters that are not printable, such as line
                breaks, become escapes, and the middle of a message of more than 2000 characters is left out.
        """
        if len(message) > 2000:
            message = f"{message[:1000]} ... {message[-1000:]}"
        super().__init__(printable(message))


class CarigsWarning(UserWarning):
    """Something likely to be wrong, or left out: the work goes on, and the run repeats the line at its end."""

    def __init__(self, message: str) -> None:
        """Keep the message in one line.

        Args:
            message: The message, as of `CarigsError`.
        """
        super().__init__(printable(message))


class InputError(CarigsError):
    """A file that cannot be used: missing, broken, of another shape, or with invalid values."""

    def __init__(self, problem: str, *, file: str | Path, field: str | None = None, remedy: str = "") -> None:
        """Compose the message `file: field: problem; remedy: remedy`.

        Args:
            problem: What is wrong.
            file: The file or folder.
            field: Array, key or position in the file.
            remedy: What to do about it, unless `problem` says so.
        """
        self.problem, self.file, self.field, self.remedy = problem, str(file), field, remedy
        where = f"{self.file}: {field}" if field else self.file
        super().__init__(f"{where}: {problem}; remedy: {remedy}" if remedy else f"{where}: {problem}")


@contextmanager
def collecting(errors: list[InputError] | None, remedy: str = "") -> Iterator[None]:
    """Keep an error of the block, so that what follows is checked as well.

    Args:
        errors: Receives the `InputError` that ends the block; None to raise it.
        remedy: What to do about kept errors that have no remedy of their own: a reader does not know who named a file.

    Yields:
        Nothing.
    """
    try:
        yield
    except InputError as error:
        if errors is None:
            raise
        error.remedy = error.remedy or remedy
        errors.append(error)


class SettingsError(CarigsError):
    """A setting with an unknown name, of the wrong type, or outside its range."""


class MeshError(CarigsError):
    """A mesh that no solver can use; the message names the vertex or face."""


class PackageMissing(CarigsError):
    """A package that is not installed; the message names the extra of carigs that brings it."""


class WeightsMissing(CarigsError):
    """Network weights that are not installed; the message names the file, where it was expected and its source."""


OUT_OF_MEMORY = ("not enough memory", "can't allocate memory", "out of memory", "can't start new thread")
"""What libraries write into a `RuntimeError` when the machine has no more memory or threads."""


def one_line(error: BaseException) -> str | None:
    """Describe an error that a user or the machine causes, and no mistake of the program.

    Args:
        error: Anything raised.

    Returns:
        One line without a traceback: for `CarigsError`, an interrupt (Ctrl-C), a lack of memory or threads, input that
        is nested too deeply, and errors of the file system, such as a full disk. None for every other error.
    """
    if isinstance(error, CarigsError):
        return str(error)
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    detail = " ".join(str(error).split())[:500]
    if isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(text in detail for text in OUT_OF_MEMORY)
    ):
        return f"not enough memory ({detail})" if detail else "not enough memory"
    if isinstance(error, RecursionError):
        return f"nested too deeply ({detail})"
    if isinstance(error, OSError):  # NumPy reports a full disk without a number: "8 requested and 0 written"
        problem = error.strerror or detail or type(error).__name__
        return str(CarigsError(f"{error.filename}: {problem}" if error.filename else problem))
    return None


def exit_code(error: BaseException) -> int:
    """Exit code of a program that ends with an error.

    Args:
        error: Anything raised.

    Returns:
        130 for an interrupt, as shells have it, else 1.
    """
    return 130 if isinstance(error, KeyboardInterrupt) else 1


def report(error: BaseException) -> int:
    """End a program with an error: print its line on stderr, or raise it if it is a mistake of the program.

    Args:
        error: Anything raised.

    Returns:
        The exit code.

    Raises:
        BaseException: The error itself, if `one_line` has no line for it.
    """
    line = one_line(error)
    if line is None:
        raise error
    if isinstance(error, BrokenPipeError):  # the flush at the end of Python would fail, too, and be reported
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    print_line(line)
    return exit_code(error)


def print_line(line: str) -> None:
    """Print "carigs: " and a line on stderr, in one write: lines of processes that print at once do not mix.

    Where stderr is not buffered (`PYTHONUNBUFFERED`), `print` writes the line break apart from the text.

    Args:
        line: The line without its break.
    """
    sys.stderr.write(f"carigs: {line}\n")
    sys.stderr.flush()
