"""What values of a calibration state that a camera is a pinhole without distortion and skew.

Programs write the same in several ways: `false`, `0`, `"0.0"` and `"none"`, or the name of a camera model whose
coefficients are all 0.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

PINHOLES = re.compile(
    r"(?!\d)(pinhole|perspective|projective|rectilinear|linear|ideal|frame|simple|full|standard|inverse|modified"
    "|camera|model|lens|opencv|brown|conrady|plumbbob|rad(ial)?|tan(gential)?|rational|poly(nomial)?|division|thinprism"
    r"|k?\d|t\d|none|null|no|distortion|undistorted)*"
)
"""Camera models, in lower case, that are a pinhole if all coefficients of distortion are 0: names of OpenCV, ROS
(plumb_bob), Kalibr (pinhole-radtan), OpenMVG (pinhole_radial_k3), RealSense (inverse_brown_conrady) and others."""
NOTHING = ("", "none", "null", "no", "false", "off", "n/a")
"""Texts in lower case that state nothing."""
RIGHT_ANGLES = (90, math.pi / 2)
"""In degrees and radians: some programs state the angle between the axes of pixels in place of a skew."""


def is_zero(value: Any) -> bool:
    """Whether all numbers in a value are 0.

    Args:
        value: Anything that JSON can hold. Null, false, and texts such as "0.0" and "none" count as 0; a model in an
            object is compared with `PINHOLES`.

    Returns:
        Whether nothing in it moves pixels.
    """
    match value:
        case dict():
            return all(is_pinhole(v) if re.search("model|type", k.lower()) else is_zero(v) for k, v in value.items())
        case list():
            return all(map(is_zero, value))
        case str():
            return all(word.lower() in NOTHING or _number(word) == 0 for word in re.split(r"[\s,;\[\]()]+", value))
    return not value


def is_true(value: Any) -> bool:
    """Whether a value states yes, or nothing.

    Args:
        value: Anything that JSON can hold.

    Returns:
        Whether it is null, true, 1, or a text for these.
    """
    return value is None or str(value).strip().lower() in ("true", "yes", "on", "1", "1.0")


def is_square(value: Any) -> bool:
    """Whether a skew leaves pixels square.

    Args:
        value: The skew, or the angle between the axes of pixels.

    Returns:
        Whether it is 0, or a right angle.
    """
    angle = _number(str(value))
    return is_zero(value) or any(math.isclose(angle, right, rel_tol=1e-7) for right in RIGHT_ANGLES)


def is_pinhole(value: Any) -> bool:
    """Whether a camera model is a pinhole if all coefficients of distortion are 0.

    Args:
        value: Name of the model.

    Returns:
        Whether `PINHOLES` has it; null is the default, a pinhole.
    """
    if value is None:
        return True
    return isinstance(value, str) and bool(PINHOLES.fullmatch(re.sub("[^a-z0-9]", "", value.lower())))


def is_identity(value: Any) -> bool:
    """Whether a transform or scale of the world changes nothing.

    Args:
        value: A number, or a matrix of up to 4 x 4 whose last row may be missing.

    Returns:
        Whether it is null, 1, or has ones on the diagonal alone.
    """
    try:
        matrix = np.atleast_2d(np.asarray(1 if value is None else value, np.float64))
    except (TypeError, ValueError):
        return False
    return bool((matrix == np.eye(4)[: len(matrix), : matrix.shape[1]]).all()) if max(matrix.shape) <= 4 else False


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan
