"""The machine: card, driver, torch, gsplat, compiler."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

import torch

from evaluation.benchmarks.gpu.figures import Figure, Task

PACKAGES = "torch", "triton", "gsplat", "numba", "numpy"


def measure(task: Task) -> Iterator[Figure]:
    """Describe the machine.

    Args:
        task: The device.

    Yields:
        Names and versions.
    """
    if task.cuda:
        card = torch.cuda.get_device_properties(task.device)
        yield Figure("card", "name", card.name)
        yield Figure("card", "memory", card.total_memory / 2**30, "GiB")
        yield Figure("card", "compute capability", f"{card.major}.{card.minor}")
        yield Figure("card", "multiprocessors", card.multi_processor_count)
        yield Figure("card", "driver", _line("nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"))
    yield Figure("processor", "name", _processor())
    yield Figure(
        "processor", "cores", len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    )
    yield Figure("system", "name", platform.platform())
    yield Figure("Python", "version", platform.python_version())
    for package in PACKAGES:
        try:
            yield Figure(package, "version", version(package))
        except PackageNotFoundError:
            yield Figure(package, "version", "not installed")
    yield Figure("torch", "CUDA", torch.version.cuda or "none")
    yield Figure("nvcc", "version", _line("nvcc", "--version"))


def _line(*command: str) -> str:
    """Last line that a program prints, or why there is none."""
    if shutil.which(command[0]) is None:
        return "not installed"
    try:
        printed = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True).stdout.split("\n")
    except (subprocess.SubprocessError, OSError) as error:
        return f"fails: {error}"
    return [line for line in printed if line.strip()][-1].strip()


def _processor() -> str:
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
