"""One part of the report, in a process of its own.

Example:
    python -m evaluation.benchmarks.gpu.part frames cuda results/gpu/frames.jsonl
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from evaluation.benchmarks.gpu.figures import Task, write_figures
from evaluation.benchmarks.gpu.runner import DEVICES, LIMITS
from evaluation.command_line import run


def main() -> None:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=LIMITS)
    parser.add_argument("device", choices=DEVICES)
    parser.add_argument("figures", type=Path, help="file to write")
    arguments = parser.parse_args()
    import torch

    module = import_module(f"evaluation.benchmarks.gpu.{arguments.part}")
    write_figures(arguments.figures, module.measure(Task(torch.device(arguments.device))))


if __name__ == "__main__":
    run(main)
