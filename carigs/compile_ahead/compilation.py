"""The stages of a study on the capture of a ball: all kernels that its jobs will need are compiled on the way.

Numba compiles one kernel at a time in a process. So a second process trains on the real frames of the ball, which needs
no other stage, and compiles the kernels of the training meanwhile. Each kernel is compiled by the process that needs it
first; the other one waits for it (`carigs.simd.kernels.kernel`).
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from carigs.compile_ahead.ball_capture import write_ball_capture
from carigs.config import compose_study, compose_variant
from carigs.settings import STAGES
from carigs.settings.option import Section
from carigs.simd.kernel_cache import kernel_folder, kernel_lock, kernels_are_compiled
from carigs.system.run_process import end_with_run_process

NUM_STEPS = 4
"""Steps of each training."""


def compile_for(part: str, study: Sequence[str], folder: Path) -> None:
    """Compile a part of the kernels of all variants of a study.

    Args:
        part: `stages`, from GT* frames to renderings, or `training`, without what hair and GT* frames need in addition.
        study: Hydra overrides of the study.
        folder: Folder to create, for the capture and the results, which mean nothing.
    """
    index = write_ball_capture(folder / "ball")
    for variant, settings in _variants(study).items():
        PARTS[part](settings, index, folder / variant)


def _variants(study: Sequence[str]) -> dict[str, DictConfig]:
    """Settings of the variants that train on the host, by name; all subjects need the same kernels."""
    names = compose_study(*study).study
    settings = {name: compose_variant(name, *study, f"subject={names.subjects[0]}") for name in names.variants}
    return {name: of_variant for name, of_variant in settings.items() if of_variant.train.backend == "cpu"}


def _run_stages(settings: DictConfig, index: Path, folder: Path) -> None:
    from carigs.stages.gtstar import gtstar
    from carigs.stages.hair import hair
    from carigs.stages.render import render

    gamma, found, targets = settings.gamma, folder / "hair.npz", folder / "targets.json"
    paths = {"capture": index, "path": folder / "path.npz"}
    _exaggerate(settings, paths)
    hair(_section(settings, "hair", labels=None), capture=index, found=found)
    gtstar(
        _section(settings, "gtstar"), **paths, hair=found, level=gamma,
        targets=folder / "targets", index=targets, resume_key="",
    )  # fmt: skip
    avatar = _train(settings, paths, folder, hair=found, targets=[targets])
    render(
        _section(settings, "render", orbit_frames=0, levels=[0.0, gamma]),
        avatar=avatar, **paths, frames=folder / "frames", resume_key="",
    )  # fmt: skip


def _run_training(settings: DictConfig, index: Path, folder: Path) -> None:
    paths = {"capture": index, "path": folder / "path.npz"}
    _exaggerate(settings, paths)
    _train(settings, paths, folder, hair=None, targets=None, gtstar_probability=0.0, relight_surfels=False)


PARTS = {"stages": _run_stages, "training": _run_training}
"""What a process runs for each variant, by name."""


def _exaggerate(settings: DictConfig, paths: Mapping[str, Path]) -> None:
    from carigs.stages.exaggerate import exaggerate

    paths["path"].parent.mkdir()
    exaggerate(_section(settings, "exaggerate", file=None, regions={}), **paths)


def _train(
    settings: DictConfig,
    paths: Mapping[str, Path],
    folder: Path,
    hair: Path | None,
    targets: Sequence[Path] | None,
    **changes: object,
) -> Path:
    """Train for a few steps; return the avatar's file."""
    from carigs.stages.train import train

    density = {} if not settings.train.density.every else {"start": 1, "every": 1, "stop": NUM_STEPS}
    short = {"iterations": NUM_STEPS, "budget": None, "start": None, "density": density}
    avatar = folder / "avatar.npz"
    train(
        _section(settings, "train", **short, **changes), **paths, hair=hair, targets=targets,
        avatar=avatar, ply=folder / "avatar.ply", log=folder / "log.csv", resume_key="",
    )  # fmt: skip
    return avatar


def _section(settings: DictConfig, stage: str, **changes: object) -> Section:
    merged = OmegaConf.merge(OmegaConf.structured(STAGES[stage]), settings[stage], changes)
    return OmegaConf.to_object(merged)


def main() -> None:
    """Compile a part for a study, unless it was done before; end with the run.

    The arguments are the name of the part and the Hydra overrides of the study.
    """
    end_with_run_process()
    if hasattr(os, "nice"):
        os.nice(19)
    part, *study = sys.argv[1:]
    cache = kernel_folder()
    if cache is None:  # where nothing can be kept, nothing is worth being compiled
        return
    folder = cache / f"compile_ahead_{part}"
    with kernel_lock(folder.name):
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
        if not kernels_are_compiled():
            try:
                compile_for(part, study, folder)
            finally:
                shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
