"""Runs the parts of the report, each in a process of its own with a time limit: one that fails does not end others."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from evaluation.benchmarks.gpu.figures import read_figures

LIMITS = {"machine": 60, "kernels": 300, "checks": 180, "trainings": 480, "frames": 60, "networks": 60}
"""Seconds of each part, in the order in which they run."""
DEVICES = "cuda", "cpu"
LAST_LINES = 3
"""Lines of a log that say why a part failed."""


def run_part(name: str, device: str, folder: Path, limit: float) -> dict[str, Any]:
    """Run a part.

    Args:
        name: One of `LIMITS`.
        device: One of `DEVICES`.
        folder: Where its figures and its log go.
        limit: Seconds after which it is ended.

    Returns:
        `part`, `end` (`done`, `failed` or `out of time`), `why` (last lines of the log of a part that failed),
        `seconds` and `figures`.
    """
    figures, log, start = folder / f"{name}.jsonl", folder / f"{name}.log", time.perf_counter()
    figures.unlink(missing_ok=True)
    with log.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", "evaluation.benchmarks.gpu.part", name, device, str(figures)],
            stdout=stream, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            end = "failed" if process.wait(limit) else "done"
        except subprocess.TimeoutExpired:
            end = "out of time"
        finally:  # compilers and tests that it has started end, too
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    lines = [line for line in log.read_text(errors="replace").splitlines() if line.strip()]
    why = "" if end == "done" else " | ".join(lines[-LAST_LINES:]) or f"exit status {process.returncode}"
    return {
        "part": name,
        "end": end,
        "why": why,
        "seconds": round(time.perf_counter() - start, 1),
        "figures": [figure._asdict() for figure in read_figures(figures)],
    }
