"""Kernels and tensors in forked processes: the results of the parent, and no process that hangs or is ended."""

import os
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")

KERNELS = """
import concurrent.futures, multiprocessing, os, sys, threading, time
import numba
import numpy as np
from numba import njit
from numba.extending import intrinsic
from carigs.simd.forks import is_forked
from carigs.simd.kernels import INLINE, kernel, parallel_for

fork = multiprocessing.get_context("fork")
SECONDS = 100

@njit(**INLINE)
def square(i, squares):
    squares[i] = i * i

@kernel
def fill(squares):
    parallel_for(square, len(squares), (squares,))

@kernel(parallel=True)
def double(values):
    doubled = np.empty_like(values)
    for i in numba.prange(len(values)):
        doubled[i] = 2 * values[i]
    return doubled

def work(n=1000):
    squares = np.zeros(n)
    fill(squares)
    return double(squares).sum()

def expected(n=1000):
    return 2.0 * sum(i * i for i in range(n))

def in_pool(function=work, context=fork):
    with context.Pool(2) as pool:
        return pool.map_async(function, [1000, 1001, 7]).get(SECONDS)

EXPECTED = [expected(n) for n in (1000, 1001, 7)]
"""
SCENARIOS = {
    "pool": """
assert work() == expected() and not is_forked()
assert in_pool() == EXPECTED
assert work() == expected() and not is_forked()  # the parent has its threads
""",
    "executor": """
work()
with concurrent.futures.ProcessPoolExecutor(2, mp_context=fork) as pool:
    assert list(pool.map(work, [1000, 1001, 7], timeout=SECONDS)) == EXPECTED
""",
    "kernels first in the fork": """
assert in_pool() == EXPECTED
""",
    "one of two kernels first in the fork": """
fill(np.zeros(3))
assert in_pool() == EXPECTED
""",
    "fork of a fork": """
work()
def nested(n):
    child, result = os.fork(), work(n)
    if child == 0:
        os._exit(int(result == work(n) == expected(n)))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 1
    return result
assert in_pool(nested) == EXPECTED
""",
    "threads of the fork": """
work()
def in_threads(n):
    with concurrent.futures.ThreadPoolExecutor(3) as threads:
        results = set(threads.map(work, [n] * 9))
    return results.pop() if len(results) == 1 else results
assert in_pool(in_threads) == EXPECTED
""",
    "fork in a thread, while another one runs kernels": """
work()
stopping = threading.Event()
def run():
    while not stopping.is_set():
        work(100_000)
busy = threading.Thread(target=run)
busy.start()
with concurrent.futures.ThreadPoolExecutor(1) as thread:
    for _ in range(5):
        assert thread.submit(in_pool).result() == EXPECTED
stopping.set()
busy.join()
""",
    "fork while another thread compiles": """
work()
@intrinsic
def slowly(typingctx, x):
    compiling.set()
    time.sleep(3)
    return x(x), lambda context, builder, signature, values: values[0]
@kernel
def slow(x):
    return slowly(x)
compiling = threading.Event()
thread = threading.Thread(target=slow, args=(1,))
thread.start()
compiling.wait()
assert in_pool() == EXPECTED
thread.join()
""",
    "a number of threads that is set in the fork": """
work()
def more_threads(n):
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    return work(n)
assert in_pool(more_threads) == EXPECTED
""",
    "an error of a task": """
@njit(**INLINE)
def fail(i, values):
    if i == 5:
        raise ValueError("the fifth")
@kernel
def fail_all(values):
    parallel_for(fail, len(values), (values,))
work()
def message(n):
    try:
        fail_all(np.zeros(n))
    except ValueError as error:
        return str(error)
assert in_pool(message) == ["the fifth"] * 3
""",
}
TENSORS = """
import torch
def sums(n):
    values = torch.arange(3_000_000.0)
    return float((values.sin() * n).sum().round(decimals=-3))
"""
WITH_TORCH = {
    "tensors, then kernels in the fork": TENSORS
    + """
sums(1)
def both(n):
    return work(n) + 0 * sums(n)
assert in_pool(both) == EXPECTED
""",
    "kernels, then tensors in the fork": """
work()
def both(n):
    exec(TENSORS, globals())
    return work(n) + 0 * sums(n)
assert in_pool(both) == EXPECTED
""",
    "as many threads as a training has, in the fork": TENSORS
    + """
from carigs.simd.threads import use_threads
use_threads(2)
sums(1)
work()
def both(n):
    use_threads(2)
    return work(n) + 0 * sums(n)
assert in_pool(both) == EXPECTED
""",
    "a DataLoader": TENSORS
    + """
sums(1)
work()
class Works(torch.utils.data.Dataset):
    def __len__(self):
        return 6
    def __getitem__(self, i):
        return work(i + 10) + 0 * sums(i)
loader = torch.utils.data.DataLoader(Works(), batch_size=2, num_workers=2, timeout=SECONDS)
assert torch.cat(list(loader)).tolist() == [expected(i + 10) for i in range(6)]
""",
    "spawned processes": """
work()
assert __name__ != "__main__" or in_pool(context=multiprocessing.get_context("spawn")) == EXPECTED
""",
}


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kernels")
    path = os.pathsep.join([os.environ.get("PYTHONPATH", ""), os.getcwd()])
    return {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder)}


def outcome(scenario, environment, tmp_path, **variables):
    """Exit code and errors of a process in a session of its own: whatever it leaves is ended with it."""
    file = tmp_path / "scenario.py"
    file.write_text(f"TENSORS = '''{TENSORS}'''\n{KERNELS}{scenario}")
    process = subprocess.Popen(
        [sys.executable, str(file)], env={**environment, **variables}, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        errors = process.communicate(timeout=180)[1]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        return "hangs", process.communicate()[1]
    return process.returncode, re.sub("carigs: compiling kernels into .*\n", "", errors)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [*SCENARIOS, *WITH_TORCH][1:])
def test_forked_processes_compute_what_their_parent_does(scenario, environment, tmp_path):
    assert outcome({**SCENARIOS, **WITH_TORCH}[scenario], environment, tmp_path) == (0, "")


@pytest.mark.slow
def test_also_with_plain_numba(environment, tmp_path):
    assert outcome(SCENARIOS["pool"], environment, tmp_path, CARIGS_PLAIN_NUMBA="1") == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("layer", ["omp", "workqueue"])
def test_also_with_every_threading_layer(layer, environment, tmp_path):
    assert outcome(SCENARIOS["pool"], environment, tmp_path, NUMBA_THREADING_LAYER=layer) == (0, "")


def test_a_fork_of_a_process_that_has_run_kernels_gives_its_results(environment, tmp_path):
    assert outcome(SCENARIOS["pool"], environment, tmp_path) == (0, "")
