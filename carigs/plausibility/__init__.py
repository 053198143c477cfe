"""Plausibility of a capture: do its parts fit each other, before any work starts?

What cannot be true is an `InputError`. What is only likely to be wrong is one line of text, a warning.

- `check_capture`: all checks of a capture
- `resolve_cy`: principal points in OpenCV's convention, whichever the files have
"""

from carigs.plausibility.check import check_capture
from carigs.plausibility.principal_point import resolve_cy

__all__ = ["check_capture", "resolve_cy"]
