"""The process that compiles beside the jobs of a run."""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from collections.abc import Sequence

COMPILE_AHEAD = "CARIGS_COMPILE_AHEAD"
"""Environment variable: with the value 0, each job compiles its own kernels."""


def start_compiling(study: Sequence[str]) -> None:
    """Compile the kernels of a study in a process of low priority, which ends with this one at the latest.

    Without it, or where it fails, the jobs compile the same kernels themselves.

    Args:
        study: Hydra overrides of the study.
    """
    if os.environ.get(COMPILE_AHEAD) == "0" or (os.cpu_count() or 1) == 1:
        return
    command = [sys.executable, "-m", "carigs.compile_ahead.compilation", *study]
    nothing = subprocess.DEVNULL
    atexit.register(_end, subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing))


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    process.wait()
