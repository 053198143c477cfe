"""Damaged files of compiled kernels are never run: the kernel is compiled again, with the same result."""

import errno
import os
import pickle
import random
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from carigs.errors import CarigsWarning
from carigs.simd import kernel_cache, kernel_files
from carigs.simd.kernels import kernel

VALUES = np.linspace(-1, 2, 7)
AS_ROOT = hasattr(os, "getuid") and os.getuid() == 0


def polynomial(x):
    return 3 * x * x - x


def other(x):
    return 7 * x


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for module in (kernel_files, kernel_cache):
        monkeypatch.setattr(module, "kernel_folder", lambda: tmp_path)
    return tmp_path


def run(function=polynomial, values=VALUES):
    """Result of a kernel in what might be a fresh process, and whether it came from a file."""
    compiled = kernel(function)
    return compiled(values).tobytes(), sum(compiled.stats.cache_hits.values()) == 1


def kernel_of(folder, function=polynomial):
    (file,) = folder.glob(f"*.{function.__name__}.*.kernel")
    return file


def flip_one_bit(file):
    content = bytearray(file.read_bytes())
    content[random.Random(3).randrange(len(content))] ^= 4
    file.write_bytes(content)


def make_folder(file):
    file.unlink()
    (file / "with something in it").mkdir(parents=True)


def link_to(target):
    def damage(file):
        file.unlink()
        file.symlink_to(target)

    return damage


def pickle_that_runs(file):
    class Canary:
        def __reduce__(self):
            return Path(file.with_name("canary")).touch, ()

    file.write_bytes(pickle.dumps(Canary()))


def seal_of_before(file):
    """A right digest in front of other content."""
    file.write_bytes(file.read_bytes()[: kernel_files.SEAL_BYTES] + b"\x80\x04N.")


def kernel_of_another(file):
    run(other)
    shutil.copy(kernel_of(file.parent, other), file)


DAMAGES = {
    "empty": lambda file: file.write_bytes(b""),
    "one byte": lambda file: file.write_bytes(file.read_bytes()[:1]),
    "cut in the digest": lambda file: file.write_bytes(file.read_bytes()[:20]),
    "cut in the code": lambda file: file.write_bytes(file.read_bytes()[:-100]),
    "longer": lambda file: file.write_bytes(file.read_bytes() + b"\0"),
    "zeros, as after a power failure": lambda file: file.write_bytes(bytes(file.stat().st_size)),
    "random bytes": lambda file: file.write_bytes(random.Random(0).randbytes(5000)),
    "one bit": flip_one_bit,
    "text": lambda file: file.write_text("<<<<<<< HEAD\n"),
    "a pickle that runs code": pickle_that_runs,
    "digest of other content": seal_of_before,
    "the file of another kernel": kernel_of_another,
    "a folder": make_folder,
    "a link to nothing": link_to("nothing"),
    "a link to itself": lambda file: link_to(file)(file),
    "a link to a device": link_to("/dev/zero"),
    "a pipe": lambda file: (file.unlink(), os.mkfifo(file)),
    "unreadable": lambda file: file.chmod(0),
    "missing": lambda file: file.unlink(),
}


@pytest.mark.sample(6)
@pytest.mark.skipif(os.name != "posix", reason="links, pipes and permissions of POSIX")
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_replaced_and_the_result_is_the_same(damage, folder):
    expected = polynomial(VALUES).tobytes()
    assert [run(), run()] == [(expected, False), (expected, True)]
    DAMAGES[damage](kernel_of(folder))
    with warnings.catch_warnings():
        warnings.simplefilter("error", CarigsWarning)
        readable = damage == "unreadable" and AS_ROOT  # permissions do not bind
        assert [run(), run()] == [(expected, readable), (expected, True)]
    assert not (folder / "canary").exists()


def no_space(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_on_a_full_disk_kernels_run_and_one_line_says_that_they_are_not_kept(folder, monkeypatch):
    monkeypatch.setattr(kernel_files, "writing", no_space)
    with pytest.warns(CarigsWarning, match="No space left") as warned:
        assert run() == (polynomial(VALUES).tobytes(), False)
        assert run(other) == (other(VALUES).tobytes(), False)
    assert len(warned) == 1 and str(folder) in str(warned[0].message)
    assert not list(folder.glob("*.kernel"))


def test_without_a_folder_kernels_run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for module in (kernel_files, kernel_cache):
        monkeypatch.setattr(module, "kernel_folder", lambda: None)
    assert [run(), run()] == [(polynomial(VALUES).tobytes(), False)] * 2
    kernel(polynomial).recompile()
    assert not list(tmp_path.iterdir())


def test_each_signature_has_a_file_of_its_own(folder):
    for values in (VALUES, VALUES.astype(np.float32), VALUES[::2], np.arange(3)):
        assert run(values=values) == (polynomial(values).tobytes(), False)
    assert len(list(folder.glob("*.kernel"))) == 4
    assert all(run(values=values)[1] for values in (VALUES, VALUES[::2], np.arange(3)))


def test_recompilation_removes_the_files(folder):
    compiled = kernel(polynomial)
    compiled(VALUES)
    compiled._cache.flush()
    assert not list(folder.glob("*.kernel"))


def test_a_kernel_with_a_closure_is_not_kept(folder):
    """Its code depends on values that no file name has."""

    def times(factor):
        return kernel(lambda x: factor * x)

    assert [times(factor)(VALUES).tobytes() for factor in (2, 3)] == [(2 * VALUES).tobytes(), (3 * VALUES).tobytes()]
    assert not list(folder.glob("*.kernel"))


SCRIPT = """
import numpy as np
from carigs.simd.kernels import kernel

@kernel
def polynomial(x, *more):
    return FACTOR * x * x - more[0]

compiled = polynomial(np.arange(4.0), 1.0)
print(compiled.sum(), sum(polynomial.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_a_script_finds_its_kernels_again_until_it_is_edited(tmp_path):
    def outcome(factor):
        (tmp_path / "script.py").write_text(SCRIPT.replace("FACTOR", factor))
        path = os.pathsep.join([os.environ.get("PYTHONPATH", ""), os.getcwd()])
        environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        command = [sys.executable, str(tmp_path / "script.py")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100)
        return done.stdout.split(), done.stderr

    assert [outcome("1"), outcome("1"), outcome("2")] == [(["10.0", "0"], ""), (["10.0", "1"], ""), (["24.0", "0"], "")]
