"""Plain footage: a video or a folder of photographs becomes upright sRGB frames of one size.

- `read_footage`: either of them; `footage.Footage` is what it finds
- `selection.Selection`: which frames, and how large
- `video`, `decoder`: videos, decoded in a process with limits
- `photographs`: folders of images
- `stored`: decoded frames in a file, for those who read them often
- `measures`, `cuts`: sharpness, exposure, white balance, repeated frames and cuts of what was decoded
"""

from pathlib import Path

from carigs.footage.footage import Footage, TimedFrame
from carigs.footage.photographs import read_photographs
from carigs.footage.selection import Selection
from carigs.footage.video import read_video

__all__ = ["Footage", "Selection", "TimedFrame", "read_footage", "read_photographs", "read_video"]


def read_footage(source: Path, selection: Selection | None = None) -> Footage:
    """Find the frames of a video or of a folder of photographs.

    Args:
        source: The video or the folder.
        selection: Frames that are used, and their size; None for all as they are.

    Returns:
        The footage; iterating over it decodes its frames.

    Raises:
        InputError: If there is no such file or folder, or if it cannot be used.
    """
    return (read_photographs if Path(source).is_dir() else read_video)(Path(source), selection)
