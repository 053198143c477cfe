"""What can happen to a run: processes are killed, disks are full, folders are read-only, clocks jump."""

from __future__ import annotations

import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
from chaos.miniature_study import HYDRA, TARGETS
from project import Project, environment

RUN = (sys.executable, "-m", "snakemake", "--cores", "2", "--config")
LONGEST_RUN = 600  # seconds
KILLS = {"group": 32, "parent": 20, "worker": 24, "write": 16, "interrupt": 6, "terminate": 4, "compilation": 4}
"""How often each kind of kill happens among 106."""
OTHERS = {"clock": 6, "two runs": 4, "file limit": 4, "full disk": 2, "read-only": 4, "memory": 2}
EDITED = {"edit": 8, "two runs with other settings": 4}
"""Disturbances after which the results are those of another input, until it is undone."""
OTHER_SETTINGS = f"{HYDRA} train.position_lr=0.02"


class Run:
    """A run of the miniature study: a process group whose output goes to a file."""

    def __init__(
        self,
        project: Project,
        hydra: str = HYDRA,
        *,
        prefix: tuple[str, ...] = (),
        limit: Callable | None = None,
        **variables: str,
    ):
        self.project = project
        with (project.root / "output.log").open("a") as output:
            self.process = subprocess.Popen(
                [*prefix, *RUN, f"hydra={hydra}", "--", *TARGETS],
                cwd=project.root,
                env={**os.environ, **environment(project.root), **variables},
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=limit,
            )

    def wait(self) -> bool:
        """Whether the run has succeeded."""
        return self.process.wait(LONGEST_RUN) == 0

    def ended_within(self, seconds: float) -> bool:
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True


def processes_of(project: Project) -> list[psutil.Process]:
    """All processes that work in the project's folder."""
    found = []
    for process in psutil.process_iter():
        try:
            if Path(process.cwd()).is_relative_to(project.root) and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:
            pass
    return found


def kill(kind: str, project: Project, chance: random.Random) -> bool:
    """Start a run and kill it, or a part of it, at a random time. Returns whether it was alive then."""
    variables = {"NUMBA_CACHE_DIR": str(project.root / "kernels")} if kind == "compilation" else {}
    run = Run(project, **variables)
    if kind == "write":
        ended = _ended_before_a_write(run, chance.randrange(12))
    else:
        ended = run.ended_within(chance.uniform(4, 15) if kind == "compilation" else chance.uniform(0.5, 6))
    if ended:
        return False
    if kind == "parent":
        run.process.kill()
    elif kind == "worker":
        workers = [process for process in processes_of(project) if process.pid != run.process.pid]
        if not workers:
            os.killpg(run.process.pid, signal.SIGKILL)
        else:
            try:
                chance.choice(workers).kill()
            except psutil.NoSuchProcess:
                pass
    elif kind in ("interrupt", "terminate"):
        os.killpg(run.process.pid, signal.SIGINT if kind == "interrupt" else signal.SIGTERM)
    else:
        os.killpg(run.process.pid, signal.SIGKILL)
    run.process.wait(LONGEST_RUN)
    return True


def _ended_before_a_write(run: Run, number: int) -> bool:
    """Wait until a file with a temporary name appears for the given time."""
    seen: set[Path] = set()
    while not run.ended_within(0.002):
        with suppress(FileNotFoundError):  # a folder that was there is complete, and has its name
            seen |= set((run.project.root / "results").rglob(".*.part*"))
        if len(seen) > number:
            return False
    return True


def disturb(kind: str, project: Project, chance: random.Random) -> bool:
    """Let a run meet one of `OTHERS`. Returns whether that was possible on this machine."""
    results = project.root / "results"
    if kind == "clock":
        files = [file for folder in ("results", "data") for file in (project.root / folder).rglob("*")]
        for file in chance.sample(files, min(10, len(files))):
            then = time.time() + chance.uniform(-1, 1) * 3e8
            os.utime(file, (then, then))
    elif kind == "two runs":
        runs = [Run(project), Run(project)]
        for run in runs:
            run.wait()
    elif kind == "file limit":
        size = int(10 ** chance.uniform(3.5, 5.5))
        Run(project, limit=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))).wait()
    elif kind == "memory":
        Run(project, limit=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))).wait()
    elif kind == "full disk":
        with _small_disk(results, int(10 ** chance.uniform(5, 6))) as possible:
            if possible:
                Run(project).wait()
        return possible
    elif kind == "read-only":
        # Root may write everywhere unless it has no capabilities.
        prefix = ("setpriv", "--bounding-set=-all", "--inh-caps=-all") if os.getuid() == 0 else ()
        if prefix and not shutil.which("setpriv"):
            return False
        results.mkdir(exist_ok=True)
        folder = chance.choice([results, *(path for path in results.rglob("*") if path.is_dir())])
        folder.chmod(0o555)
        Run(project, prefix=prefix).wait()
        if folder.exists():
            folder.chmod(0o755)
    return True


@contextmanager
def _small_disk(results: Path, free: int) -> Iterator[bool]:
    """Results on a disk with little space left; yields False where none can be mounted."""
    kept = results.with_name("kept")
    results.mkdir(exist_ok=True)
    shutil.copytree(results, kept, symlinks=True)
    used = sum((file.stat().st_size + 4095) // 4096 * 4096 for file in results.rglob("*") if file.is_file())
    mount = ["mount", "-t", "tmpfs", "-o", f"size={used + free}", "tmpfs", str(results)]
    if os.getuid() or subprocess.run(mount, capture_output=True).returncode:
        shutil.rmtree(kept)
        yield False
        return
    try:
        shutil.copytree(kept, results, symlinks=True, dirs_exist_ok=True)
        shutil.rmtree(kept)
        yield True
        shutil.copytree(results, kept, symlinks=True)
    finally:
        subprocess.run(["umount", "--lazy", str(results)], check=True)
        shutil.rmtree(results)
        kept.rename(results)


def _replace(file: Path, change: Callable[[str], str]) -> Callable[[], None]:
    before = file.read_bytes()
    file.write_text(change(before.decode()))
    assert file.read_bytes() != before, file
    return lambda: file.write_bytes(before)


def _edit_code(project: Project) -> Callable[[], None]:
    """Other random numbers decide which views are trained on."""
    file = project.root / "carigs/splat/training/schedule.py"
    return _replace(file, lambda text: text.replace("[seed, 0]", "[seed, 7]"))


def _edit_cameras(project: Project) -> Callable[[], None]:
    file = project.root / "data/transforms_train.json"
    return _replace(file, lambda text: text.replace('"fl_x": 150', '"fl_x": 150.5'))


def _edit_head(project: Project) -> Callable[[], None]:
    file = project.root / "data/flame_param/00000.npz"
    before = file.read_bytes()
    arrays = dict(np.load(file))
    np.savez(file, **{**arrays, "translation": arrays["translation"] + 0.0005})
    return lambda: file.write_bytes(before)


def _edit_settings(project: Project) -> Callable[[], None]:
    file = project.root / "conf/study/mini.yaml"
    return _replace(file, lambda text: text.replace("train: {", "train: {initial_scale: 0.3, "))


EDITS = {"code": _edit_code, "cameras": _edit_cameras, "head parameters": _edit_head, "settings": _edit_settings}
"""Edits of a project, each returns how it is undone."""


@contextmanager
def edited(project: Project, kind: str) -> Iterator[None]:
    """The project with an edit of `EDITS`."""
    undo = EDITS[kind](project)
    try:
        yield
    finally:
        undo()


def two_runs_with_other_settings(project: Project, chance: random.Random) -> None:
    """Two working folders whose results are the same folder: one run makes it at a time."""
    second = Project(project.root.with_name("second"))
    shutil.copytree(project.root, second.root, symlinks=True, ignore=shutil.ignore_patterns("results", ".snakemake"))
    (project.root / "results").mkdir(exist_ok=True)
    (second.root / "results").symlink_to(project.root / "results")
    runs = [Run(project)]
    time.sleep(chance.uniform(0, 4))
    runs.append(Run(second, OTHER_SETTINGS))
    for run in runs:
        run.wait()
    shutil.rmtree(second.root)


def schedule(kills: int, chance: random.Random) -> list[str]:
    """Kinds of kills and of other disturbances in a random order; fewer than 20 kills are of the cheap kinds."""
    if kills < 20:
        return [*chance.sample(["group", "parent", "worker", "write"], min(kills, 4)), "clock"]
    share = kills / sum(KILLS.values())
    counts = {kind: max(1, round(share * count)) for kind, count in {**KILLS, **OTHERS, **EDITED}.items()}
    counts["group"] += max(0, kills - sum(counts[kind] for kind in KILLS))
    events = [kind for kind, count in counts.items() for _ in range(count)]
    chance.shuffle(events)
    return events


def outputs(project: Project) -> dict[str, bytes]:
    """Contents of all results but logs, records, card and report, which hold times; by path."""
    results = project.root / "results"
    return {
        str(file.relative_to(results)): file.read_bytes()
        for file in sorted(results.rglob("*"))
        if file.is_file()
        and not any(part.startswith(".") for part in file.relative_to(results).parts)
        and not re.search(r"/log/|/log\.csv$|/card\.(json|md)$|/report\.html$|\.checkpoint$|\.part$", str(file))
    }
