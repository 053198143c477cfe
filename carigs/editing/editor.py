"""The editors of frames, by their names in the settings."""

from __future__ import annotations

from carigs.capture import Capture
from carigs.editing.view import Editor
from carigs.errors import SettingsError
from carigs.settings import Edit

DRIFTS = {"drawn_nose": 0.0, "drawn_nose_2px": 2.0, "drawn_nose_5px": 5.0}
"""Editors without networks, and how far in pixels the noses of two views may lie apart from where they agree."""


def make_editor(settings: Edit, capture: Capture, seed: int) -> Editor:
    """Prepare the editor that settings name; networks are loaded.

    Args:
        settings: Section `train.edit`; its editor is not `none`.
        capture: The subject.
        seed: Seed of the training.

    Returns:
        The editor.

    Raises:
        WeightsMissing: Weights of the network, or its library, are missing.
        InputError: The files of a network are not valid.
        SettingsError: The head model lacks what the editor needs.
    """
    if settings.editor in DRIFTS:
        from carigs.editing.drawn_nose import DrawnNose

        if "nose" not in capture.model.regions:
            raise SettingsError(f"train.edit.editor={settings.editor}: the head model has no region nose")
        return DrawnNose(capture.model, DRIFTS[settings.editor], seed)
    if settings.editor == "controlnet_ip2p":
        from carigs.editing.controlnet_ip2p import load_controlnet_ip2p

        return load_controlnet_ip2p(settings, capture.background)
    from carigs.editing.instruct_pix2pix import load_instruct_pix2pix

    return load_instruct_pix2pix(settings, capture.background)
