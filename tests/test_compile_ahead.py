"""Are the kernels that are compiled ahead those that the jobs need?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from chaos.miniature_study import HYDRA, copy_miniature_study

from carigs.capture import Capture
from carigs.compile_ahead import process
from carigs.compile_ahead.ball_capture import RADIUS, write_ball_capture
from carigs.compile_ahead.compilation import PARTS
from carigs.simd.kernel_cache import kernel_folder

TAKE_FROM_CHECKOUT = """

def _take(self, signature, target_context, load=KernelFiles.load_overload):
    target_context.refresh()
    file = self._file(signature, target_context.codegen())
    kept = Path({kept!r}, file.name)
    if not file.exists() and kept.is_file():
        shutil.copyfile(kept, file)
    return load(self, signature, target_context)


KernelFiles.load_overload = _take
"""
"""Added to `carigs/simd/kernel_files.py`: a kernel that the checkout has is copied where it would be compiled.

The cache gets the same files as by compilation, which takes minutes; a kernel that the checkout lacks is compiled."""


def compiled(cache: Path) -> set[str]:
    """Files with machine code in a cache: one for each kernel and signature."""
    return {file.name for file in cache.rglob("*.kernel")}


@pytest.mark.slow
def test_jobs_of_a_study_compile_nothing_that_was_not_compiled_ahead(tmp_path, monkeypatch):
    project = copy_miniature_study(tmp_path / "project")
    if kept := kernel_folder():
        project.edit("carigs/simd/kernel_files.py", add=TAKE_FROM_CHECKOUT.format(kept=str(kept)))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    ahead = project.command("carigs.compile_ahead.compilation", "stages", HYDRA)
    assert ahead.returncode == 0, ahead.stderr
    before = compiled(tmp_path / "cache")
    assert not [*(tmp_path / "cache").rglob("capture.json")]  # nothing else stays behind
    assert all(any(word in name for name in before) for word in ("forward_simd", "backward_simd", "carigs.gtstar"))
    project.make("reproduce", hydra=HYDRA)
    assert compiled(tmp_path / "cache") == before
    # Some are gone: the part for trainings compiles those that it needs, and no others.
    gone = {name for name in before if "_simd" in name or "carigs.gtstar" in name}
    for file in (tmp_path / "cache").rglob("*.kernel"):
        if file.name in gone:
            file.unlink()
    ahead = project.command("carigs.compile_ahead.compilation", "training", HYDRA)
    assert ahead.returncode == 0, ahead.stderr
    again = compiled(tmp_path / "cache") & gone
    assert compiled(tmp_path / "cache") <= before  # no work that the jobs do not need
    assert any("backward_simd" in name for name in again) and not any("carigs.gtstar" in name for name in again)


def test_a_capture_of_a_ball_has_all_splits_and_shows_the_ball(tmp_path):
    ball = Capture.load(write_ball_capture(tmp_path / "ball"))
    assert all(ball.split(name) for name in ("train", "val", "test"))
    for frame in ball.frames:
        camera, matte = ball.camera(frame), ball.mask8(frame) > 127
        distance = np.linalg.norm(camera.centre)
        radius = camera.fx * RADIUS / np.sqrt(distance**2 - RADIUS**2)  # of the silhouette of a sphere, on its axis
        assert abs(matte.sum() / (np.pi * radius**2) - 1) < 0.05
        assert (ball.image8(frame)[~matte] == 255).all() and np.ptp(ball.image8(frame)[matte], axis=0).min() > 50


@pytest.mark.parametrize(
    ("value", "cpus", "starts"), [("0", 4, False), ("1", 1, False), ("1", 4, True), (None, 4, True)]
)
def test_a_variable_and_a_single_processor_switch_it_off(monkeypatch, value, cpus, starts):
    started = []
    monkeypatch.setattr(process.subprocess, "Popen", lambda command, **_: started.append(command))
    monkeypatch.setattr(process.atexit, "register", lambda *_: None)
    monkeypatch.setattr(process.os, "cpu_count", lambda: cpus)
    monkeypatch.delenv(process.COMPILE_AHEAD, raising=False)
    if value:
        monkeypatch.setenv(process.COMPILE_AHEAD, value)
    process.start_compiling(["study=toy", "train.iterations=12"])
    assert [command[1:] for command in started] == [
        ["-m", "carigs.compile_ahead.compilation", part, "study=toy", "train.iterations=12"] for part in PARTS
    ] * starts
