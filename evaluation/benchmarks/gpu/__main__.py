"""Build, check and measure the backend `cuda` on this machine; docs/gpu.md has the table of a report.

Every part runs in a process of its own with a time limit. One that fails, hangs or is killed does not end the others;
the exit status is then 1. `gpu.json` holds all figures and the ends of the parts, `PART.log` what a part printed.

Example:
    python -m evaluation.benchmarks.gpu results/gpu
    python -m evaluation.benchmarks.gpu results/gpu --device cpu --parts machine checks
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from carigs.system.files import writing
from evaluation.benchmarks.gpu.document import table
from evaluation.benchmarks.gpu.runner import DEVICES, LIMITS, run_part
from evaluation.command_line import run


def main() -> bool:
    """Run the program.

    Returns:
        Whether a part has failed.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder to write to")
    parser.add_argument("--device", choices=DEVICES, default="cuda", help="cpu: what can be tried without a GPU")
    parser.add_argument("--parts", nargs="+", choices=LIMITS, default=list(LIMITS), help="all by default")
    parser.add_argument("--limit", type=float, help="seconds of every part, instead of its own limit")
    task = parser.parse_args()
    task.folder.mkdir(parents=True, exist_ok=True)
    report = []
    for name in task.parts:
        part = run_part(name, task.device, task.folder, task.limit or LIMITS[name])
        print(f"{name}: {part['end']}, {part['seconds']:.0f} s {part['why']}", flush=True)
        report.append(part)
        with writing(task.folder / "gpu.json") as file:
            file.write_text(json.dumps({"device": task.device, "parts": report}, indent=1) + "\n", encoding="utf-8")
    print(table(report))
    return any(part["end"] != "done" for part in report)


if __name__ == "__main__":
    run(main)
