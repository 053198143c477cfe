"""Kernels compiled through Numba's public interface alone: the same results."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from simd import small_scene

from carigs.simd import kernels
from carigs.simd.kernel_cache import kernel_folder


def test_private_classes_are_used_for_known_versions_only():
    plain = os.environ.get("CARIGS_PLAIN_NUMBA") or numba.version_info.short not in kernels.LINKED_NUMBA
    assert ("pipeline_class" in kernels.INLINE) == (not plain)


@pytest.mark.slow
def test_tests_of_kernels_pass_with_plain_numba():
    """Vectors, tasks on all threads, and errors of tasks, which no kernel of the small scene raises."""
    folder = Path(__file__).parent
    root, cache = folder.parents[1], kernel_folder() / "plain-tests"
    setting = {"CARIGS_PLAIN_NUMBA": "1", "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(root)}
    command = [sys.executable, "-m", "pytest", "-m", "not slow", "-p", "no:cacheprovider", "--no-cov", str(folder)]
    done = subprocess.run(command, env={**os.environ, **setting}, cwd=root, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout


@pytest.fixture(scope="module")
def plain():
    return small_scene.compiled_and_cached("plain", CARIGS_PLAIN_NUMBA="1")


@pytest.mark.slow
def test_plain_kernels_give_the_same_results(plain):
    _, results = plain
    assert not results["linked"]
    for name, expected in {**small_scene.rendered(), **small_scene.seen_triangles()}.items():
        assert np.isfinite(results[name]).all(), name
        error = np.linalg.norm(results[name] - expected) / np.linalg.norm(expected)
        assert error < 1e-6, (name, error)
    assert results["finite_at_limits"].all()


@pytest.mark.slow
def test_plain_kernels_from_the_cache_give_the_same_bytes(plain):
    small_scene.check_bytes(*plain)
