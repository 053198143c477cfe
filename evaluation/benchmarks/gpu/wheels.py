"""Collect the packages that the report needs beyond common ones, for a machine without a network.

The machine needs numpy, scipy, numba, torch, OpenCV, pandas, Pillow, jaxtyping, rich, psutil, filelock, threadpoolctl,
pytest and hypothesis; this program collects the others for one version of Python, on Linux with an x86-64 processor.

Example:
    python -m evaluation.benchmarks.gpu.wheels wheels --python 3.12
    pip install --no-index --no-deps wheels/*.whl                       # on the other machine
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from carigs.errors import CarigsError
from evaluation.command_line import run

WHEELS = (
    "gsplat==1.5.3",
    "libigl",
    "trimesh",
    "hydra-core",
    "omegaconf",
    "plyfile",
    "beartype",
    "open_clip_torch",
    "ftfy",
    "wcwidth",
    "ftfy",
    "wcwidth",
)
"""Packages that are fetched as wheels."""
SOURCES = ("antlr4-python3-runtime==4.9.3",)
"""Packages of pure Python that have no wheels: they are built here."""
PLATFORMS = "manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"
MOST_BYTES = 60 * 2**20


def main() -> None:
    """Run the program.

    Raises:
        CarigsError: A package cannot be had, or the folder is larger than `MOST_BYTES`.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder to write to")
    parser.add_argument("--python", default="3.12", help="version of Python of the other machine")
    task = parser.parse_args()
    task.folder.mkdir(parents=True, exist_ok=True)
    pip = [sys.executable, "-m", "pip"]
    target = ["--python-version", task.python, "--implementation", "cp", "--only-binary=:all:"]
    platforms = [part for name in PLATFORMS for part in ("--platform", name)]
    commands = (
        [*pip, "download", "--quiet", "--no-deps", *target, *platforms, "-d", str(task.folder), *WHEELS],
        [*pip, "wheel", "--quiet", "--no-deps", "-w", str(task.folder), *SOURCES],
    )
    for command in commands:
        if subprocess.run(command, check=False).returncode:
            raise CarigsError(f"{command[3]}: pip could not fetch {' '.join(WHEELS)}")
    size = sum(file.stat().st_size for file in task.folder.glob("*.whl"))
    print(f"{task.folder}: {len(list(task.folder.glob('*.whl')))} wheels, {size / 2**20:.1f} MiB")
    if size > MOST_BYTES:
        raise CarigsError(f"{task.folder}: larger than {MOST_BYTES / 2**20:.0f} MiB")


if __name__ == "__main__":
    run(main)
