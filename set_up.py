"""Make the environment .venv with what requirements.lock pins; without CUDA where there is no NVIDIA GPU.

On Linux, the builds of torch on PyPI need 2 GB of CUDA libraries. PyTorch has builds without them on an index of its
own, under the same version with the label +cpu. The lock has no hashes of these: those of the index are checked.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.request import urlopen

ROOT = Path(__file__).parent
UV = "uv==0.13.8"
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
LABELLED = ("torch", "torchvision")
"""Packages that come from `CPU_INDEX`."""
OF_CUDA = re.compile(r"nvidia-|cuda-|triton$")
"""Packages that only the builds with CUDA need."""
SIZES = {"cpu": "0.6 GB to download, 2.2 GB on disk", "lock": "3.1 GB to download, 6 GB on disk"}
"""Measured on Linux with Python 3.11, the build `cpu` with the wheel of torch 2.13."""
NOT_COMPILED = (
    r"/(transformers|diffusers|timm|sympy|pip|setuptools|docutils|huggingface_hub|triton|lexers|tests?"
    r"|testing/_internal|torch/(_dynamo|_inductor|distributed|onnx))/"
)
"""Folders of packages that most studies do not import, or only in part."""


def has_nvidia_gpu() -> bool:
    """Whether a driver of NVIDIA is at work here, in Linux or in WSL.

    Returns:
        True also in doubt: then CUDA is installed.
    """
    drivers = ("/proc/driver/nvidia/version", "/dev/nvidia0", "/usr/lib/wsl/lib/libcuda.so.1")
    return shutil.which("nvidia-smi") is not None or any(map(os.path.exists, drivers))


def is_reachable(index: str) -> bool:
    """Whether an index of packages answers.

    Args:
        index: Its address.

    Returns:
        Whether it lists torch.
    """
    try:
        with urlopen(f"{index}/torch/", timeout=10):
            return True
    except OSError:
        return False


def choose_build(wanted: str) -> tuple[str, str]:
    """Choose the builds of torch.

    Args:
        wanted: `cpu`, `lock`, or `auto` for what this machine needs.

    Returns:
        `cpu` or `lock`, and why.
    """
    if wanted != "auto":
        return wanted, "as asked for"
    if sys.platform != "linux":
        return "lock", "on this system it has no CUDA"
    if has_nvidia_gpu():
        return "lock", "with CUDA for the NVIDIA GPU"
    if not is_reachable(CPU_INDEX):
        return "lock", f"with CUDA, though there is no NVIDIA GPU: {CPU_INDEX} cannot be reached"
    return "cpu", "without CUDA, as there is no NVIDIA GPU"


def split_lock(lock: str) -> tuple[str, list[str]]:
    """Divide a lock into what comes from it and what comes from `CPU_INDEX`.

    Args:
        lock: Text of requirements.lock.

    Returns:
        The lock without `LABELLED` and without CUDA, and the requirements of `LABELLED`.
    """
    kept, labelled = [], []
    for block in re.split(r"\n(?=\S)", lock.strip()):
        name, _, version = re.split(r"[ \\]", block, maxsplit=1)[0].partition("==")
        if name in LABELLED:
            labelled.append(f"{name}=={version}+cpu")
        elif not OF_CUDA.match(name):
            kept.append(block)
    return "\n".join(kept) + "\n", labelled


def installations(build: str, environment: Path) -> list[list[str]]:
    """What is installed, one after the other.

    Args:
        build: `cpu` or `lock`.
        environment: Folder of the environment. The part of the lock that `cpu` needs is written there.

    Returns:
        Arguments of `uv pip install`.
    """
    lock = ROOT / "requirements.lock"
    carigs = ["--no-deps", "--editable", str(ROOT)]
    if build == "lock":  # torch 2.11.0+cpu would count as 2.11.0
        again = [argument for name in LABELLED for argument in ("--reinstall-package", name)]
        return [["--require-hashes", *again, "--requirement", str(lock)], carigs]
    part = environment / "requirements-cpu.lock"
    kept, labelled = split_lock(lock.read_text("utf-8"))
    part.write_text(kept, "utf-8")
    return [
        ["--no-deps", "--default-index", CPU_INDEX, *labelled],
        ["--no-deps", "--require-hashes", "--requirement", str(part)],
        carigs,
    ]


def set_up(environment: Path, wanted: str, *, only_lock: bool, dry_run: bool) -> None:
    """Make the environment, or bring it up to date.

    Args:
        environment: Its folder.
        wanted: As for `choose_build`.
        only_lock: Leave out carigs itself.
        dry_run: Only say what would be installed.
    """
    build, why = choose_build(wanted)
    print(f"{environment}: torch {why}; {SIZES[build]}", flush=True)
    if dry_run:
        return
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    python = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", UV], check=True)
    for arguments in installations(build, environment)[: -1 if only_lock else None]:
        subprocess.run([python, "-m", "uv", "pip", "install", "--python", python, *arguments], check=True)
    # Some machines never write bytecode. Without it everything works, too.
    subprocess.run([python, "-m", "compileall", "-q", "-j", "0", "-x", NOT_COMPILED, environment / "lib"], check=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Its arguments; `sys.argv` if None.

    Returns:
        Exit code.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--environment", type=Path, default=ROOT / ".venv", metavar="FOLDER", help="default: .venv")
    torch_help = "auto: without CUDA where there is no NVIDIA GPU; cpu: without; lock: as on PyPI (default %(default)s)"
    parser.add_argument("--torch", choices=("auto", "cpu", "lock"), default="auto", help=torch_help)
    parser.add_argument("--only-lock", action="store_true", help="leave out carigs itself, as for a layer of an image")
    parser.add_argument("--dry-run", action="store_true", help="only say what would be installed")
    task = parser.parse_args(arguments)
    try:
        set_up(task.environment.absolute(), task.torch, only_lock=task.only_lock, dry_run=task.dry_run)
    except subprocess.CalledProcessError as error:
        return error.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
