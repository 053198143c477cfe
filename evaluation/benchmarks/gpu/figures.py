"""What a part is given, the figures that it finds, and the file that it writes them to."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import torch


class Task(NamedTuple):
    """What a part measures."""

    device: torch.device

    @property
    def cuda(self) -> bool:
        """Whether the device is one of CUDA."""
        return self.device.type == "cuda"


class Figure(NamedTuple):
    """One thing that a part has found out."""

    case: str
    """What was measured, such as `toy, cuda`."""
    quantity: str
    value: float | str
    unit: str = ""


def write_figures(file: Path, figures: Iterable[Figure]) -> None:
    """Write figures as they come, so that those of a part that is ended later are kept.

    Args:
        file: File to write, one JSON object per line.
        figures: The figures.
    """
    with file.open("w", encoding="utf-8") as stream:
        for figure in figures:
            print(json.dumps(figure._asdict()), file=stream, flush=True)
            value = figure.value if isinstance(figure.value, str) else f"{figure.value:.4g}"
            print(f"{figure.case}: {figure.quantity} {value} {figure.unit}".rstrip(), flush=True)


def read_figures(file: Path) -> Iterator[Figure]:
    """Read the figures of a part; a line that was cut is left out.

    Args:
        file: File of `write_figures`; it may not exist.

    Yields:
        The figures.
    """
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines(keepends=True):
            if line.endswith("\n"):
                yield Figure(**json.loads(line))
