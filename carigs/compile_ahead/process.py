"""The processes that compile beside the jobs of a run."""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from collections.abc import Sequence

PARTS = ("stages", "training")
"""What each process compiles (`carigs.compile_ahead.compilation.PARTS`)."""
COMPILE_AHEAD = "CARIGS_COMPILE_AHEAD"
"""Environment variable: with the value 0, each job compiles its own kernels."""


def start_compiling(study: Sequence[str]) -> None:
    """Compile the kernels of a study in processes of low priority, which end with this one at the latest.

    Without them, or where they fail, the jobs compile the same kernels themselves.

    Args:
        study: Hydra overrides of the study.
    """
    if os.environ.get(COMPILE_AHEAD) == "0" or (os.cpu_count() or 1) == 1:
        return
    command, nothing = [sys.executable, "-m", "carigs.compile_ahead.compilation"], subprocess.DEVNULL
    for part in PARTS:
        process = subprocess.Popen([*command, part, *study], stdin=nothing, stdout=nothing, stderr=nothing)
        atexit.register(_end, process)


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    process.wait()
