"""Stage `hair`: the triangles that hair covers, and the space that it fills."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from carigs.capture import Capture
from carigs.hair import find_hair
from carigs.settings import Hair


def hair(settings: Hair, *, capture: Path, found: Path, threads: int = 1) -> None:
    """Find the hair of a subject.

    Args:
        settings: Regions of the head, and the limit of the texture.
        capture: Input: the index of the capture.
        found: Output: what `load_hair` reads (.npz).
        threads: Timesteps read in parallel; the result does not depend on it.

    Raises:
        InputError: If no training frame can be read.
    """
    subject = Capture.load(capture)
    with ThreadPoolExecutor(threads) as pool:
        result = find_hair(settings, subject, pool.map)
    result.save(found)
    print(result.description(subject.model.face_region(*settings.regions.hair)))
