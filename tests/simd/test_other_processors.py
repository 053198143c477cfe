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


@pytest.fixture(scope="module")
def rounding():
    """How far each result moves, relative to its norm, when every attribute moves by one unit in its last place."""
    results = small_scene.rendered()
    moved = [small_scene.rendered(moved_by=np.random.default_rng(seed)) for seed in range(4)]
    return {name: max(_distance(other[name], value) for other in moved) for name, value in results.items()}


def _distance(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.slow
def test_results_on_other_processors_are_the_same(other, rounding):
    """To a few roundings: other processors add in another order."""
    _, _, results = other
    assert max(rounding.values()) < 2e-5
    for name, expected in small_scene.rendered().items():
        assert np.isfinite(results[name]).all(), name
        error = _distance(results[name], expected)
        assert error < 4 * rounding[name] + 1e-6, (name, error)


@pytest.mark.slow
def test_kernels_from_the_cache_give_the_same_bytes(other):
    small_scene.check_bytes(*other[1:])


@pytest.mark.slow
def test_limits_of_exponentials_and_roots_are_numbers_on_other_processors(other):
    _, _, results = other
    assert results["finite_at_limits"].all(), results["finite_at_limits"]
