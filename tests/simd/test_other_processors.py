"""The kernels compiled for processors with narrower vectors: the same results."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding
from simd import small_scene

ROOT = Path(__file__).parents[2]


def _runs_here(processor):
    features = binding.get_host_cpu_features()
    return features.get("sse2", False) and (processor != "haswell" or (features.get("avx2") and features.get("fma")))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folders with the results of `small_scene`, of processes that compile all kernels and of others that load them."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ("haswell", "x86-64") if _runs_here(name)}
    for run in ("compiled", "cached"):
        running = [_start(name, folder, folder / f"{run}.npz") for name, folder in folders.items()]
        assert [process.wait(timeout=600) for process in running] == [0] * len(running)
    return folders


def _start(processor, cache, file):
    setting = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(cache)}
    environment = {**os.environ, **setting, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, small_scene.__file__, str(file)], env=environment)


@pytest.fixture(scope="module", params=["haswell", "x86-64"])
def other(request, folders):
    if request.param not in folders:
        pytest.skip(f"this machine cannot run code for {request.param}")
    folder = folders[request.param]
    return request.param, np.load(folder / "compiled.npz"), np.load(folder / "cached.npz")


@pytest.mark.slow
def test_code_for_other_processors_has_no_wide_registers(other):
    processor, results, _ = other
    assert set(results["registers"]) == ({"xmm", "ymm"} if processor == "haswell" else {"xmm"})


@pytest.mark.slow
def test_results_on_other_processors_are_the_same(other):
    _, results, _ = other
    for name, expected in small_scene.rendered().items():
        assert np.isfinite(results[name]).all(), name
        error = np.linalg.norm(results[name] - expected) / np.linalg.norm(expected)
        assert error < 1e-5, (name, error)


@pytest.mark.slow
def test_kernels_from_the_cache_give_the_same_bytes(other):
    _, compiled, cached = other
    for name in set(compiled.files) - {"registers"}:
        np.testing.assert_array_equal(cached[name], compiled[name], err_msg=name)


@pytest.mark.slow
def test_limits_of_exponentials_and_roots_are_numbers_on_other_processors(other):
    _, results, _ = other
    assert results["finite_at_limits"].all(), results["finite_at_limits"]
