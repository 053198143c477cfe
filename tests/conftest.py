"""Array shapes in signatures are checked while the tests run; property tests draw the same examples every time."""

from __future__ import annotations

import os
import signal

import hypothesis
import pytest
import typecheck

os.environ.setdefault("MPLBACKEND", "Agg")
# Several test processes share the cores: threads that wait for work must not spin.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("GOMP_SPINCOUNT", "0")
# Runs share the kernels of this checkout.
os.environ.setdefault("CARIGS_COMPILE_AHEAD", "0")
# A shell starts background jobs with SIGINT ignored. Programs that tests interrupt would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("repeatable")

typecheck.install("carigs", "evaluation", "stress")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, those of whole studies before others: none of them is left for the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in slow, "workflow" not in item.path.parts))
