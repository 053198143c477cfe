"""Array shapes in signatures are checked while the tests run; property tests draw the same examples every time."""

from __future__ import annotations

import gc
import importlib
import os
import signal
from collections import defaultdict

import hypothesis
import pytest
import typecheck
from threadpoolctl import threadpool_limits

os.environ.setdefault("MPLBACKEND", "Agg")
# Several test processes share the cores: threads that wait for work must not spin.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("GOMP_SPINCOUNT", "0")
# Those of BLAS do, whatever they are told: a third of the time of tests with small matrices. Processes that tests start
# have all threads. What is limited is what is loaded, and SciPy has a BLAS of its own.
importlib.import_module("scipy.linalg")
threadpool_limits(1, "blas")
# Runs share the kernels of this checkout.
os.environ.setdefault("CARIGS_COMPILE_AHEAD", "0")
# Imported modules are a million objects, and no garbage: to look for some takes a third of the time of collection, and
# a quarter of that of small tests.
gc.disable()
# A shell starts background jobs with SIGINT ignored. Programs that tests interrupt would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("repeatable")

WHOLE_STUDIES = {"workflow", "docs", "chaos", "test_compile_ahead.py"}
"""Folders and files whose tests make studies."""

typecheck.install("carigs", "evaluation", "stress")


def pytest_collection_finish() -> None:
    """Look for garbage again, rarely, and never among what is imported."""
    gc.freeze()
    gc.set_threshold(100_000, 50, 1000)
    gc.enable()


def pytest_runtest_setup() -> None:
    typecheck.begin_test()


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what -m does not select
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave most cases of dear tests to the slow ones, and order the files.

    Of a test with the marker `sample(n)`, n cases are fast, evenly spread. Files with slow tests come first, those of
    whole studies before others: none of them is left for the end, where one process would wait for the other.
    """
    cases = defaultdict(list)
    for item in items:
        if sample := item.get_closest_marker("sample"):
            cases[item.path, item.originalname, *sample.args].append(item)
    for (_, _, count), found in cases.items():
        fast = {i * len(found) // count for i in range(count)}
        for i, item in enumerate(found):
            if i not in fast:
                item.add_marker("slow")
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in slow, WHOLE_STUDIES.isdisjoint(item.path.parts)))
