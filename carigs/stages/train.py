"""Stage `train`: optimise the surfels on real frames and GT* targets in turn."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from carigs.capture import Capture
from carigs.errors import SettingsError
from carigs.exaggeration import GammaPath
from carigs.files import writing
from carigs.settings import Train


def train(
    settings: Train,
    *,
    capture: Path,
    path: Path,
    targets: Sequence[Path] | None,
    avatar: Path,
    ply: Path,
    log: Path,
) -> None:
    """Write the trained avatar, its .ply (SurFhead's layout) and the log.

    `targets` are the indices of GT* frames, one per level; None may do where `gtstar_probability` is 0 and no light is
    followed.  The run's state is kept beside `avatar` (suffix `.checkpoint`) until it is done.
    """
    if settings.gtstar_probability > 0 and not targets:
        raise SettingsError(f"train.gtstar_probability={settings.gtstar_probability} needs targets, and there are none")
    # torch before numba's threads start: both then share one pool.
    from carigs.simd.threads import use_threads

    use_threads(settings.threads)
    from carigs.capture.target_index import read_targets
    from carigs.light.fitting import load_shading
    from carigs.splat.avatar import Avatar, save_avatar
    from carigs.splat.rig.head_sequence import head_sequence
    from carigs.splat.surfels.ply import write_ply
    from carigs.splat.training.supervision import Supervision
    from carigs.splat.training.trainer import COLUMNS, train_surfels

    subject, gamma_path = Capture.load(capture), GammaPath.load(path)
    sequence = head_sequence(subject, gamma_path)
    sets = [read_targets(index, subject) for index in targets or ()]
    if sets and settings.relight_surfels:
        sequence.shading = load_shading(sets[-1].folder / "shading.npz")  # one light for all levels
    supervision = Supervision(subject, sets if settings.gtstar_probability > 0 else (), settings.mask_flags)
    checkpoint = avatar.with_suffix(".checkpoint")
    surfels, rows = train_surfels(settings, sequence, supervision, checkpoint)
    trained = Avatar(surfels, sequence, settings.rig, settings.rotate_harmonics, subject.background)
    with writing(log) as part, part.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    write_ply(ply, surfels)
    save_avatar(avatar, trained)
    checkpoint.unlink(missing_ok=True)
