"""Stage `train`: optimize the surfels on real frames and GT* targets, alternating at random."""

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
    """Train an avatar; an interrupted run is resumed from a checkpoint next to the avatar (suffix `.checkpoint`).

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path.
        targets: Input: the indexes of GT* frames, one per level. May be None if `gtstar_probability` is 0 and colours
            do not follow the light.
        avatar: Output: the trained avatar.
        ply: Output: its surfels in SurFhead's layout.
        log: Output: the training log (CSV).
    """
    check_settings(settings, targets)
    # torch before numba's threads start: both then share one pool.
    from carigs.simd.threads import use_threads

    use_threads(settings.threads)
    from carigs.capture.target_index import SHADING, read_targets
    from carigs.light.shading import load_shading
    from carigs.splat.avatar import Avatar, save_avatar
    from carigs.splat.rig.head_sequence import head_sequence
    from carigs.splat.surfels.ply import write_ply
    from carigs.splat.training.supervision import Supervision
    from carigs.splat.training.trainer import COLUMNS, train_surfels

    subject = Capture.load(capture)
    performance = head_sequence(subject, GammaPath.load(path))
    sets = [read_targets(index, subject) for index in targets or ()]
    if sets and settings.follow_light:
        performance.shading = load_shading(sets[-1].folder / SHADING)  # one light for all levels
    supervision = Supervision(subject, sets if settings.gtstar_probability > 0 else (), settings.mask_flags)
    checkpoint = avatar.with_suffix(".checkpoint")
    surfels, rows = train_surfels(settings, performance, supervision, checkpoint)
    trained = Avatar(surfels, performance, settings.rig, settings.rotate_harmonics, subject.background)
    with writing(log) as part, part.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    write_ply(ply, surfels)
    save_avatar(avatar, trained)
    checkpoint.unlink(missing_ok=True)


def check_settings(settings: Train, targets: Sequence[Path] | None) -> None:
    """Check the settings of the stage before any work.

    Args:
        settings: Settings of the stage.
        targets: The indexes of GT* frames.

    Raises:
        SettingsError: For a value out of range.
    """
    for name, low, high in (
        ("gtstar_probability", 0, 1), ("iterations", 1, 10**9), ("threads", 1, 10**4), ("sh_degree", 0, 3),
        ("surfels_per_face", 1, 1000), ("hair_layers", 0, 1000), ("ssim_weight", 0, 1), ("log_every", 1, 10**9),
        ("initial_opacity", 1e-6, 1 - 1e-6), ("initial_scale", 1e-6, 1e6), ("colour_frames", 1, 10**6),
    ):  # fmt: skip
        if not low <= getattr(settings, name) <= high:
            raise SettingsError(f"train.{name}={getattr(settings, name)} must lie in [{low}, {high}]")
    for name, low, high in (
        ("max_surfels", 1, 10**9),
        ("replace_fraction", 0, 1),
        ("importance_views", 1, 10**6),
        ("prune_opacity", 0, 1),
    ):
        value = getattr(settings.density, name)
        if not low <= value <= high:
            raise SettingsError(f"train.density.{name}={value} must lie in [{low}, {high}]")
    for name in ("translation_lr", "rotation_lr", "expression_lr"):
        if not 0 <= getattr(settings.refine_tracking, name) < 1:
            raise SettingsError(
                f"train.refine_tracking.{name}={getattr(settings.refine_tracking, name)} must lie in [0, 1)"
            )
    if settings.rig not in ("jbs", "jacobian"):
        raise SettingsError(f"train.rig={settings.rig} is unknown; choose jbs or jacobian")
    if settings.gtstar_probability > 0 and not targets:
        raise SettingsError(f"train.gtstar_probability={settings.gtstar_probability} needs targets, and there are none")
