"""Stage `train`: optimize the surfels on real frames and GT* targets, alternating at random."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from carigs.capture import Capture
from carigs.errors import SettingsError
from carigs.head import read_subject_path
from carigs.settings import Train
from carigs.system.files import writing


def train(
    settings: Train,
    *,
    capture: Path,
    path: Path,
    hair: Path | None = None,
    targets: Sequence[Path] | None,
    avatar: Path,
    ply: Path,
    log: Path,
    resume_key: str,
    threads: int = 1,
) -> None:
    """Train an avatar; an interrupted run is resumed from a checkpoint next to the avatar (suffix `.checkpoint`).

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path.
        hair: Input: where hair is (`carigs.hair`); None if there is none.
        targets: Input: the indexes of GT* frames, one per level. May be None if `gtstar_probability` is 0 and colours
            do not follow the light.
        avatar: Output: the trained avatar.
        ply: Output: its surfels in SurFhead's layout.
        log: Output: the training log (CSV).
        resume_key: Digest of all that the outputs depend on; a checkpoint with another one is not used.
        threads: Threads of the rasterizer. On one machine a training also uses cores of the run that no other job uses;
            the result depends on neither.

    Raises:
        SettingsError: GT* frames are to supervise, and there are none; or frames are edited, and GT* frames supervise.
        WeightsMissing: Weights of the editor are missing.
        InputError: An input is malformed.
    """
    if settings.gtstar_probability > 0 and not targets:
        raise SettingsError(f"train.gtstar_probability={settings.gtstar_probability} needs targets, and there are none")
    edited = settings.edit.editor != "none"
    if edited and settings.gtstar_probability > 0:
        problem = f"train.edit.editor={settings.edit.editor} edits real frames, which train.gtstar_probability=0 takes"
        raise SettingsError(problem)
    # torch before numba's threads start: both then share one pool.
    from carigs.simd.threads import use_idle_cores, use_threads

    use_threads(threads)
    from carigs.capture.target_index import read_targets
    from carigs.hair import load_hair
    from carigs.plausibility.coverage import capture_coverage
    from carigs.splat.avatar import Avatar, save_avatar
    from carigs.splat.surfels.ply import write_ply
    from carigs.splat.training.checkpoint import Checkpoint
    from carigs.splat.training.subject import prepare_subject
    from carigs.splat.training.trainer import COLUMNS, train_surfels

    person = Capture.load(capture)
    found = None if hair is None else load_hair(hair, len(person.model.faces))
    gamma_path = read_subject_path(path, person.model)
    sets = [read_targets(index, person) for index in targets or ()]
    edits = None
    if edited:
        from carigs.editing.dataset_update import DatasetUpdate

        edits = DatasetUpdate(settings.edit, person, settings.seed, from_avatar=settings.start is not None)
        gamma_path = gamma_path.still()  # an editor changes the images; nothing exaggerates the mesh
    subject = prepare_subject(person, gamma_path, settings, found, sets)
    same = subject.same_from_all_sides
    if same is not None and same.all():
        print(
            f"the views are far apart: no colours depend on the view, in spite of train.sh_degree={settings.sh_degree}"
        )
    checkpoint = Checkpoint(avatar.with_suffix(".checkpoint"), resume_key)
    surfels, rows = train_surfels(settings, subject, checkpoint, lambda _: use_idle_cores(threads), edits)
    seen = str(capture_coverage(person) or "")
    trained = Avatar(surfels, subject.sequence, settings.rig, settings.rotate_harmonics, person.background, seen=seen)
    with writing(log) as part, part.open("w", newline="") as stream:
        csv.writer(stream).writerows([COLUMNS, *rows])
    write_ply(ply, surfels)
    save_avatar(avatar, trained)
    checkpoint.file.unlink(missing_ok=True)
