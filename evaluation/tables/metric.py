"""What a reader of a table must know of a metric; `evaluation.metrics.catalogue` has one of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

TABLES = {
    "paper": "Table 1 of the paper",
    "readings": "Other readings of the paper's metrics",
    "truth": "Against the true caricature",
    "geometry": "Adherence to the caricature mesh",
    "identity": "Identity",
    "further": "Further metrics",
}
"""Title of each table, in their order."""


class Metric(NamedTuple):
    """Heading, direction and definition of a metric, and the table that shows it.

    Attributes:
        title: Heading of its column.
        better: Which values are better; `neither` if a value cannot be ranked without another one.
        digits: Digits after the decimal point in tables.
        unit: Unit of the values; empty for pure numbers.
        source: Definition or publication.
        table: The table that has a column of it: a key of `TABLES`.
        protocol: Frames of the column: `test` (held-out sequence) or `orbit` (novel trajectory). Records of other
            protocols, such as `val` (held-out camera), get a table of their own.
    """

    title: str
    better: Literal["higher", "lower", "neither"]
    digits: int
    unit: str
    source: str
    table: Literal["paper", "readings", "truth", "geometry", "identity", "further"] = "further"
    protocol: Literal["test", "orbit"] = "test"


Catalogue = Mapping[str, Metric]
"""Metrics by their name in the records, in the order of the tables."""
