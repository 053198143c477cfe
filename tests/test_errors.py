"""Errors that a user or the machine causes end in one line; mistakes of the program keep their traceback."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys

import numpy as np
import pytest

from carigs.cli.main import main
from carigs.errors import InputError, one_line, print_line


def full_disk():
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "results/avatar.npz")


def too_large():
    np.empty(1 << 62, np.uint8)


def too_deep():
    too_deep()


def interrupted():
    raise KeyboardInterrupt


def refused():
    raise InputError("two\nlines", file="a.npz", field="v")


def no_memory_in_torch():
    raise RuntimeError("[enforce fail] DefaultCPUAllocator: not enough memory: you tried\nto allocate 8 bytes")


CAUSES = {
    full_disk: ("results/avatar.npz: No space left on device", 1),
    too_large: ("not enough memory (Unable to allocate", 1),
    too_deep: ("nested too deeply", 1),
    interrupted: ("interrupted", 130),
    refused: ("a.npz: v: two", 1),
    no_memory_in_torch: ("not enough memory", 1),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_what_the_machine_or_the_user_causes_is_one_line_and_an_exit_code(cause, monkeypatch, capsys):
    monkeypatch.setattr("carigs.cli.settings.main", lambda _: cause())
    expected, code = CAUSES[cause]
    assert main(["settings"]) == code
    printed = capsys.readouterr().err
    assert printed.startswith(f"carigs: {expected}") and printed.count("\n") == 1


@pytest.mark.parametrize("mistake", [ValueError("x"), RuntimeError("x"), IndexError("x"), SystemExit(2)])
def test_mistakes_of_the_program_are_raised(mistake, monkeypatch):
    def fail(_):
        raise mistake

    assert one_line(mistake) is None
    monkeypatch.setattr("carigs.cli.settings.main", fail)
    with pytest.raises(type(mistake)):
        main(["settings"])


WORDS = pytest.mark.parametrize("words", [["settings", "--reference"], ["--help"], ["--version"]])


@WORDS
def test_a_reader_that_closes_the_pipe_ends_the_command_in_one_line(words):
    command = [sys.executable, "-m", "carigs", *words]
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert done.stderr == "carigs: Broken pipe\n" and done.returncode == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@WORDS
def test_a_full_disk_ends_the_command_in_one_line(words):
    command = [sys.executable, "-m", "carigs", *words]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.stderr == "carigs: No space left on device\n" and done.returncode == 1


def test_a_line_is_one_write_where_stderr_is_not_buffered(monkeypatch):
    class Written(io.RawIOBase):
        def __init__(self):
            self.writes = []

        def writable(self):
            return True

        def write(self, text):
            self.writes.append(bytes(text))
            return len(text)

    written = Written()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(written, write_through=True))
    print_line("compiling kernels")
    assert written.writes == [b"carigs: compiling kernels\n"]
