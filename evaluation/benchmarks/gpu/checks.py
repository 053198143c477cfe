"""The tests of a backend: those marked `gpu` on a CUDA device, those of its twins elsewhere."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from carigs.errors import CarigsError
from evaluation.benchmarks.gpu.figures import Figure, Task

ROOT = Path(__file__).parents[3]
TESTS = {
    "cuda": ("-m", "gpu", "tests/splat"),
    "cpu": ("-m", "not (slow or gpu)", "tests/splat/rasterizer/test_gsplat.py", "tests/splat/training/device"),
}
"""Arguments of pytest by type of device."""


def measure(task: Task) -> Iterator[Figure]:
    """Run the tests.

    Args:
        task: The device.

    Yields:
        Every test: `passed`, `skipped` with its reason, or the line of its failure.

    Raises:
        CarigsError: Tests failed, or none ran.
    """
    with TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-W",
            "default",
            f"--junit-xml={report}",
        ]
        subprocess.run([*command, *TESTS[task.device.type]], cwd=ROOT, check=False)
        cases = list(ElementTree.parse(report).getroot().iter("testcase")) if report.exists() else []
    failed = passed = 0
    for case in cases:
        ends = [end for end in case if end.tag in ("failure", "error", "skipped")]
        passed += not ends
        failed += any(end.tag != "skipped" for end in ends)
        line = " ".join(f"{end.tag}: {end.get('message', '')}".split("\n")[0] for end in ends) or "passed"
        yield Figure(case.get("name", ""), "test", line)
    if failed or not passed:
        raise CarigsError(f"{failed} tests failed, {passed} passed")
