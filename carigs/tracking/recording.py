"""What one camera recorded of a person, and what was found in its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from carigs.capture.evenly_spread import evenly_spread
from carigs.detection import FaceTrack
from carigs.footage import Footage
from carigs.footage.measures import FrameMeasures


class Recording(NamedTuple):
    """The frames of one camera, with landmarks and measures."""

    footage: Footage
    faces: FaceTrack
    measures: FrameMeasures

    @property
    def name(self) -> str:
        """Name of the file or folder."""
        return self.footage.source.name

    def views(self, most: int) -> list[Recording]:
        """Frames as what cameras of their own recorded at one moment: those of a camera that circles a still person.

        Args:
            most: Largest number of them; they are spread evenly.

        Returns:
            One recording of one frame for each. Their images are in memory.
        """
        chosen = {*evenly_spread(range(len(self.footage)), most)}
        images = (pair for pair in enumerate(self.footage.decode()) if pair[0] in chosen)
        return [self._view(position, image.copy()) for position, image in images]

    def _view(self, position: int, image: UInt8[np.ndarray, "h w 3"]) -> Recording:
        one, footage = slice(position, position + 1), self.footage
        alone = Footage(
            footage.source,
            footage.width,
            footage.height,
            footage.numbers[one],
            footage.times[one],
            fps=None,
            duration=None,
            focal_length=footage.focal_length,
            decode=lambda: iter((image,)),
            warnings=footage.warnings,
        )
        faces = FaceTrack(*(getattr(self.faces, field.name)[one] for field in fields(FaceTrack)))
        return Recording(alone, faces, FrameMeasures(*(values[one] for values in self.measures)))


def oddities(recordings: Sequence[Recording]) -> list[str]:
    """What is unusual about footage: files that are cut off, and frames that show more than one face.

    Args:
        recordings: The footage. Views of one file say the same once.

    Returns:
        Sentences that name the files.
    """
    lines = [*dict.fromkeys(line for recording in recordings for line in recording.footage.warnings)]
    several: dict[Path, int] = {}
    for recording in recordings:
        source = recording.footage.source
        several[source] = several.get(source, 0) + int((recording.faces.faces > 1).sum())
    shown = "{} of its images show more than one face; one of them is followed"
    return lines + [f"{source}: {shown.format(count)}" for source, count in several.items() if count]
