"""The steps of a training before which a frame is edited."""

from __future__ import annotations

from typing import Any

REAL_SHARE = 0.5
"""Share of the steps before the first edit, in which the avatar is trained on the captured frames. A training that
starts from an avatar (`train.start`) has none."""
LAST_SHARE = 0.8
"""Share of the steps with edits after which frames stay as they are: 4000 of 5000 in GaussianEditor."""


def first_edit(iterations: int, from_avatar: bool = False) -> int:
    """The first step with an edit.

    Args:
        iterations: Steps of the training.
        from_avatar: Whether the training starts from an avatar.

    Returns:
        Its number.
    """
    return 0 if from_avatar else int(REAL_SHARE * iterations)


def last_edit(iterations: int, from_avatar: bool = False) -> int:
    """The first step after which no frame is edited.

    Args:
        iterations: Steps of the training.
        from_avatar: As in `first_edit`.

    Returns:
        Its number.
    """
    first = first_edit(iterations, from_avatar)
    return first + int(LAST_SHARE * (iterations - first))


def number_of_edits(settings: Any, iterations: int, from_avatar: bool = False) -> int:
    """How many frames are edited in a training, at most: views that show nothing of the regions are passed over.

    Args:
        settings: Section `train.edit`, as its dataclass or as OmegaConf's mapping.
        iterations: Steps of the training.
        from_avatar: As in `first_edit`.

    Returns:
        Their number; 0 without an editor.
    """
    steps = last_edit(iterations, from_avatar) - first_edit(iterations, from_avatar)
    return 0 if settings.editor == "none" else -(-steps // settings.every)
