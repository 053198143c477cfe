"""Metadata of photographs (EXIF) that a camera's calibration can start from."""

from __future__ import annotations

import warnings
from pathlib import Path

from PIL import Image

_EXIF_IFD, _FOCAL_LENGTH_IN_35MM = 0x8769, 0xA405


def focal_length_35mm(file: str | Path) -> float | None:
    """Read the focal length of a photograph as that of a 35 mm camera with the same angle of view.

    Args:
        file: PNG or JPEG file, whose header has been checked (`carigs.readers.images.read_header`).

    Returns:
        Millimetres; None if the metadata do not have it or are broken.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(file, formats=("JPEG", "PNG")) as image:
                value = float(image.getexif().get_ifd(_EXIF_IFD).get(_FOCAL_LENGTH_IN_35MM, 0))
    except Exception:  # whatever Pillow meets in broken metadata, the pictures can be used without them
        return None
    return value if 4 <= value <= 2000 else None
