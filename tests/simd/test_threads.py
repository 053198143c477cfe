"""Threads of a job beside others."""

import numba
import pytest

from carigs.simd import threads


@pytest.fixture
def share(monkeypatch):
    """Set the cores for each job of a run; the number of threads is put back afterwards."""
    before = numba.get_num_threads()
    yield lambda cores: monkeypatch.setattr(threads, "share_of_cores", lambda: cores)
    numba.set_num_threads(before)


def test_a_job_has_its_own_threads_and_those_that_no_other_job_needs(share):
    at_most = numba.config.NUMBA_NUM_THREADS
    for cores, least, expected in [(1, 1, 1), (2, 1, 2), (1, 2, 2), (3, 2, 3), (512, 1, threads.MOST_THREADS)]:
        share(cores)
        threads.use_idle_cores(least)
        assert numba.get_num_threads() == min(expected, at_most)
