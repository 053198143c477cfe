"""GT* frames in the style of one image."""

from __future__ import annotations

from pathlib import Path

from rich.progress import track

from carigs.capture import Capture
from carigs.capture.images import write_png
from carigs.editing.exemplar import load_exemplar_painter
from carigs.gtstar.exchange import EDITED, frames_to_edit
from carigs.settings import Gtstar
from carigs.system.files import writing


def edit_by_exemplar(settings: Gtstar, capture: Capture, folder: Path) -> Path:
    """Paint the training frames that an earlier run has not painted.

    Args:
        settings: Settings of the stage.
        capture: The capture.
        folder: Folder for the frames, which is kept where the run is killed.

    Returns:
        Folder of the painted frames, as for the provider `precomputed`.

    Raises:
        WeightsMissing: Weights or diffusers are missing.
        InputError: The exemplar or a file of the networks is not valid.
    """
    frames = capture.split("train")
    missing = frames_to_edit(folder, capture, frames)
    if len(missing) < len(frames):
        print(f"GT*: {len(frames) - len(missing)} of {len(frames)} frames were painted by an earlier run")
    if missing:
        paint = load_exemplar_painter(Path(settings.exemplar), settings.exemplar_strength, capture.background)
        for frame in track(missing, description="painting frames", disable=len(missing) < 10):
            with writing(folder / EDITED / f"{frame.name}.png") as part:
                write_png(part, paint(capture.image(frame)))
    return folder / EDITED
