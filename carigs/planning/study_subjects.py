"""The subjects of a study, checked before any work starts."""

from __future__ import annotations

from collections.abc import Sequence

from carigs.config import compose, compose_study
from carigs.errors import SettingsError


def check_subjects(overrides: Sequence[str]) -> str:
    """Compose a study and its subjects, and look for the frames and cameras that their settings name.

    Args:
        overrides: Hydra overrides.

    Returns:
        Name of the study.

    Raises:
        SettingsError: For wrong overrides, for a toy whose body is to be cut, and for a camera or timestep to show that
            a capture lacks.
        InputError: For a sequence or camera to hold out that a capture lacks.
    """
    study = compose_study(*overrides).study
    for subject in study.subjects:
        composed = compose(*overrides, f"subject={subject}")
        if composed.capture.source == "toy" and composed.capture.body == "cut":
            raise SettingsError("capture.body=cut is for a folder or a video; of the toy, leave out capture.toy.shirt")
        named = {composed.figures.camera, composed.figures.timestep, composed.capture.validation_camera}
        if named != {None} or composed.capture.split != "files":
            from carigs.planning.shown_frames import check_shown_frames  # reads captures: half a second

            check_shown_frames(composed)
    return study.name
