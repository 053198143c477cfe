"""The stages of a study on the capture of a ball: all kernels that its jobs will need are compiled on the way."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from carigs.compile_ahead.ball_capture import write_ball_capture
from carigs.config import compose_study, compose_variant
from carigs.run_process import end_with_run_process
from carigs.settings import STAGES
from carigs.settings.option import Section
from carigs.simd.kernel_cache import kernel_lock, kernels_are_compiled, use_kernel_cache

NUM_STEPS = 4
"""Steps of each training."""


def compile_for(study: Sequence[str], folder: Path) -> None:
    """Compile the kernels of all variants of a study from GT* frames to renderings.

    Args:
        study: Hydra overrides of the study.
        folder: Folder to create, for the capture and the results, which mean nothing.
    """
    names = compose_study(*study).study
    index = write_ball_capture(folder / "ball")
    for variant in names.variants:  # subjects need the same kernels
        settings = compose_variant(variant, *study, f"subject={names.subjects[0]}")
        if settings.train.backend == "cpu":
            _run_stages(settings, index, folder / variant)


def _run_stages(settings: DictConfig, index: Path, folder: Path) -> None:
    from carigs.stages.exaggerate import exaggerate
    from carigs.stages.gtstar import gtstar
    from carigs.stages.hair import hair
    from carigs.stages.render import render
    from carigs.stages.train import train

    folder.mkdir()
    gamma = settings.gamma
    with_path = {"capture": index, "path": folder / "path.npz"}
    exaggerate(_section(settings, "exaggerate", source="poisson", regions={}), **with_path)
    hair(_section(settings, "hair", threads=1, labels=None), capture=index, found=folder / "hair.npz")
    targets = folder / "targets.json"
    gtstar(
        _section(settings, "gtstar", threads=1), **with_path, hair=folder / "hair.npz", level=gamma,
        targets=folder / "targets", index=targets,
    )  # fmt: skip
    density = {} if not settings.train.density.every else {"start": 1, "every": 1, "stop": NUM_STEPS}
    short = {"iterations": NUM_STEPS, "budget": None, "start": None, "regularize_from": 1, "density": density}
    avatar = folder / "avatar.npz"
    train(
        _section(settings, "train", threads=1, **short), **with_path, hair=folder / "hair.npz", targets=[targets],
        avatar=avatar, ply=folder / "avatar.ply", log=folder / "log.csv",
    )  # fmt: skip
    render(
        _section(settings, "render", threads=1, orbit_frames=0, levels=[0.0, gamma]),
        avatar=avatar, **with_path, made_by="", frames=folder / "frames",
    )  # fmt: skip


def _section(settings: DictConfig, stage: str, **changes: object) -> Section:
    merged = OmegaConf.merge(OmegaConf.structured(STAGES[stage]), settings[stage], changes)
    return OmegaConf.to_object(merged)


def main() -> None:
    """Compile for a study, whose Hydra overrides are the arguments, unless it was done before; end with the run."""
    end_with_run_process()
    if hasattr(os, "nice"):
        os.nice(19)
    cache = use_kernel_cache()
    folder = cache / "compile_ahead"
    with kernel_lock("compile_ahead"):
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
        if not kernels_are_compiled(cache):
            try:
                compile_for(sys.argv[1:], folder)
            finally:
                shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
