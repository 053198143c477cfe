"""Kernels run their tasks on all threads, and are compiled by one process for all."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba import njit
from processes import started

from carigs.simd.kernels import INLINE, INLINE_ALLOC, kernel, parallel_for


@njit(**INLINE)
def note(i, seen, factor):
    if i == len(seen) - 1 and factor < 0:
        raise ValueError("negative")
    seen[i] += factor * i


@kernel
def note_all(seen, factor):
    parallel_for(note, len(seen), (seen, factor))


@njit(**INLINE_ALLOC)
def fill(i, seen, *others):
    scratch = np.full(3, i)
    seen[i] = scratch.sum() + others[0] + others[1][i]


@kernel
def fill_all(seen, *others):
    parallel_for(fill, len(seen), (seen, *others))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("count", [0, 1, 7, 1000])
def test_every_task_runs_once(threads, count):
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    try:
        seen = np.zeros(count)
        note_all(seen, 2.0)
        np.testing.assert_array_equal(seen, 2 * np.arange(count))
        fill_all(seen, 5, np.arange(count))
        np.testing.assert_array_equal(seen, 4 * np.arange(count) + 5)
    finally:
        numba.set_num_threads(before)


@njit(**INLINE)
def add_products(i, seen, pairs, scale):
    (first, second), (third,) = pairs
    seen[i] += scale * (first[i] * second + third)


@kernel
def add_all_products(seen, pairs, scale):
    parallel_for(add_products, len(seen), (seen, pairs, scale))


def test_arguments_may_be_tuples_of_tuples():
    seen, first = np.zeros(5), np.arange(5.0)
    add_all_products(seen, ((first, 2.0), (3,)), 10.0)
    np.testing.assert_array_equal(seen, 10 * (2 * first + 3))


def test_an_error_of_a_task_is_raised():
    with pytest.raises(ValueError, match="negative"):
        note_all(np.zeros(100), -1.0)
    note_all(np.zeros(100), 1.0)


CACHED = """
import numpy as np
from numba import njit
from carigs.simd.kernels import INLINE, kernel, parallel_for

@njit(**INLINE)
def note(i, seen):
    seen[i] = i

@kernel
def note_all(seen):
    parallel_for(note, len(seen), (seen,))

seen = np.zeros(4)
note_all(seen)
print(seen.sum(), sum(note_all.stats.cache_hits.values()))
"""


def test_a_kernel_from_the_cache_starts_the_threads(tmp_path):
    """Numba does so itself since 0.63 only: before, the second process crashed."""
    (tmp_path / "kernel_of_note.py").write_text(CACHED)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", ""), os.getcwd()])
    setting = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": path}
    for cache_hits in ("0", "1"):
        command = [sys.executable, "-c", "import kernel_of_note"]
        done = subprocess.run(command, env={**os.environ, **setting}, capture_output=True, text=True, timeout=100)
        assert (done.returncode, done.stdout.split()) == (0, ["6.0", cache_hits]), done.stderr


MODULE = """
import os, sys, time
from numba.extending import intrinsic
from carigs.simd.kernels import kernel

@intrinsic
def slowly(typingctx, x):
    print("compiling", flush=True)
    time.sleep(float(os.environ["SECONDS"]))
    return x(x), lambda context, builder, signature, values: values[0]

@kernel
def twice(x):
    return 2 * slowly(x)
"""


def start(folder, seconds):
    """A process that calls a kernel whose compilation takes that long."""
    (folder / "slow_kernel.py").write_text(MODULE)
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", ""), os.getcwd()])
    setting = {"NUMBA_CACHE_DIR": str(folder / "cache"), "SECONDS": str(seconds), "PYTHONPATH": path}
    code = "from slow_kernel import twice; print(twice(21), flush=True)"
    return started([sys.executable, "-c", code], env={**os.environ, **setting}, stdout=subprocess.PIPE)


@pytest.mark.slow
def test_of_two_processes_one_compiles(tmp_path):
    with start(tmp_path, 2) as one, start(tmp_path, 2) as other:
        outputs = [process.communicate(timeout=100)[0].split() for process in (one, other)]
    assert [output[-1] for output in outputs] == ["42", "42"]
    assert sum(output.count("compiling") > 0 for output in outputs) == 1


def test_a_process_killed_while_it_compiles_blocks_nobody(tmp_path):
    with start(tmp_path, 1000) as killed:
        assert killed.stdout.readline() == "compiling\n"
        with start(tmp_path, 0) as waiting:
            killed.kill()
            assert waiting.communicate(timeout=100)[0].split()[-1] == "42"
