"""Record of a benchmark."""

from __future__ import annotations

from typing import NamedTuple


class Measurement(NamedTuple):
    """One measured number."""

    case: str
    quantity: str
    unit: str
    value: float
    reference: float | None = None
    """Number that `value` is compared with, from the same run; None if there is none."""
