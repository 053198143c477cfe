"""Avatars of GaussianAvatars and SurFhead, and conversions of avatars."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from carigs.cli.convert import main as convert
from carigs.errors import InputError
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import HeadParameters
from carigs.splat.avatar import Avatar, save_avatar
from carigs.splat.formats.flame_param import write_flame_param
from carigs.splat.formats.imported_avatar import imported_avatar
from carigs.splat.formats.world_splats import bake
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.ply import write_ply
from carigs.splat.surfels.surfels import flat_discs
from stress.sound_files.ball import CAMERA, FACES, VERTICES, head_model

SURFELS, STEPS, GAMMA = 40, 2, 0.1
HEAD_MODEL = "avatar_head.npz"


def write_sound_files(folder: Path) -> None:
    """Write a sound file for every reader of splats.

    Args:
        folder: Where they are written.
    """
    random, model, n = np.random.default_rng(6), head_model(), SURFELS
    surfels = flat_discs(
        random.integers(0, len(FACES), n), random.normal(0, 0.3, (n, 3)), random.random(n) + 0.1, 0.6,
        random.random((n, 3)), 1,
    )  # fmt: skip
    for name, (layout, blend_weights) in LAYOUTS.items():
        write_ply(folder / f"{name}.ply", surfels, layout, blend_weights=blend_weights)
    model.save(folder / HEAD_MODEL)
    frames = {t: HeadParameters(expression=random.normal(size=100)) for t in range(STEPS)}
    path = straight_path(VERTICES.astype(float), FACES, 0.1 * VERTICES.astype(float), GAMMA)
    sequence = HeadSequence(model, frames, path)
    write_flame_param(folder / "flame_param.npz", sequence, model, 0.0)
    save_avatar(folder / "converted_avatar.npz", Avatar(surfels, sequence))


def _imported(ply: Path, parameters: Path) -> Any:
    """The avatar must render and bake: both must be finite."""
    avatar = imported_avatar(ply, parameters, ply.with_name(HEAD_MODEL), GAMMA)
    image, splats = avatar.render(0, GAMMA, CAMERA), bake(avatar, 0, GAMMA)
    if not all(np.isfinite(array).all() for array in (image, *splats)):
        raise AssertionError("the image or a splat is not finite")
    return image, splats


def _converted(*options: str) -> Callable[[Path], bytes]:
    """`carigs convert` of the file; the bytes that it writes."""

    def run(file: Path) -> bytes:
        output = file.with_name("converted" + options[0])
        output.unlink(missing_ok=True)
        said = io.StringIO()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
            try:
                convert([str(file), str(output), *options[1:]])
            except SystemExit as wrong_arguments:  # a folder is a capture, which needs other options
                raise InputError(said.getvalue().splitlines()[-1], file=file) from wrong_arguments
        return output.read_bytes()

    return run


LAYOUTS = {
    "gaussian_avatars": ("gaussian_avatars", False),
    "surfhead": ("surfhead", True),
    "no_jbs": ("surfhead", False),
}
"""Layout, and whether it has blend weights: 63, 90 and 86 properties."""
READERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    **{name: (lambda file: _imported(file, file.with_name("flame_param.npz")), f"{name}.ply") for name in LAYOUTS},
    "flame_param.npz": (lambda file: _imported(file.with_name("surfhead.ply"), file), "flame_param.npz"),
    "avatar to 3dgs": (_converted(".ply", "--flavour", "3dgs"), "converted_avatar.npz"),
    "avatar to glTF": (_converted(".glb", "--flavour", "morph_targets"), "converted_avatar.npz"),
    "surfels to surfels": (_converted("_again.ply", "--flavour", "gaussian_avatars"), "surfhead.ply"),
}
"""Function and file of each reader."""
