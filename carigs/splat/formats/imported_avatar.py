"""An avatar from what GaussianAvatars and SurFhead leave after a training."""

from __future__ import annotations

from pathlib import Path

from carigs.errors import SettingsError
from carigs.head import HeadModel, neutral, subject_gamma_path
from carigs.head.teeth import add_teeth
from carigs.settings import Exaggerate
from carigs.splat.avatar import Avatar
from carigs.splat.formats.flame_param import read_flame_param
from carigs.splat.rig.head_sequence import subject_sequence
from carigs.splat.surfels.ply import read_ply


def imported_avatar(ply: Path, parameters: Path, head_model: Path, gamma: float) -> Avatar:
    """Make an avatar of a trained .ply file: it moves as in the program that trained it, and along a gamma path.

    The path is solved for the subject's neutral head. This is the baseline of the paper: surfels trained on the
    natural head alone, rendered on the caricature. Harmonics stay in world axes, as in both programs.

    Args:
        ply: Surfels in one of `carigs.splat.surfels.ply.LAYOUTS`.
        parameters: Their `flame_param.npz`.
        head_model: The head model.
        gamma: gamma_f of the path.

    Returns:
        The avatar, with the timesteps of the parameters.

    Raises:
        InputError: If a file is missing or broken, or does not fit the head model.
        SettingsError: If gamma is 0.
        MeshError: If the head cannot be solved on.
    """
    if gamma == 0:
        raise SettingsError("gamma must not be 0: it is the last level of the path")
    model = HeadModel.load(head_model)
    found = read_ply(ply, len(model.faces))
    frames = read_flame_param(parameters, model)
    vertices = neutral(model, frames[0])
    path = subject_gamma_path(model, vertices, Exaggerate(gamma=gamma), list(frames.values()))
    sequence = subject_sequence(model, frames, add_teeth(path, vertices, model.faces))
    if found.layout == "gaussian_avatars":
        skinning = "similarity"
    else:
        skinning = "jbs" if found.has_blend_weights else "jacobian"
    return Avatar(found.surfels, sequence, skinning, rotate_harmonics=False, unrendered=found.unrendered)
