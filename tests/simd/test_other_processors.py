"""The kernels compiled for processors with narrower vectors: the same results."""

import numpy as np
import pytest
from llvmlite import binding
from simd import small_scene


def _runs_here(processor):
    features = binding.get_host_cpu_features()
    return features.get("sse2", False) and (processor != "haswell" or (features.get("avx2") and features.get("fma")))


@pytest.fixture(scope="module", params=["haswell", "x86-64"])
def other(request):
    processor = request.param
    if not _runs_here(processor):
        pytest.skip(f"this machine cannot run code for {processor}")
    setting = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": ""}
    return processor, *small_scene.compiled_and_cached(processor, **setting)


@pytest.mark.slow
def test_code_for_other_processors_has_no_wide_registers(other):
    processor, results, _ = other
    assert set(results["registers"]) == ({"xmm", "ymm"} if processor == "haswell" else {"xmm"})


@pytest.mark.slow
def test_results_on_other_processors_are_the_same(other):
    _, _, results = other
    for name, expected in small_scene.rendered().items():
        assert np.isfinite(results[name]).all(), name
        error = np.linalg.norm(results[name] - expected) / np.linalg.norm(expected)
        assert error < 1e-5, (name, error)


@pytest.mark.slow
def test_kernels_from_the_cache_give_the_same_bytes(other):
    small_scene.check_bytes(*other[1:])


@pytest.mark.slow
def test_limits_of_exponentials_and_roots_are_numbers_on_other_processors(other):
    _, _, results = other
    assert results["finite_at_limits"].all(), results["finite_at_limits"]
