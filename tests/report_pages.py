"""Small reports: each level has one plain colour, and every name is the given one."""

from __future__ import annotations

import numpy as np

from evaluation.card.document import Part
from evaluation.report.images import data_uri
from evaluation.report.page import Figure, LevelImages, ReportContent, Strip
from evaluation.tables.document import Cell, Document, Table

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>'\"&{{ 7 * 7 }}"
COLOURS = {"0": (1.0, 0.0, 0.0), "0.1": (0.0, 1.0, 0.0), "0.25": (0.0, 0.0, 1.0)}

AVATAR_PAGE = "anna/gamma%3D0.25/avatar.html"


def plain(colour, size=(48, 40)) -> np.ndarray:
    return np.broadcast_to(np.array(colour), (*size, 3)).copy()


def report(name: str = "anna", noise: int = 0, figures: bool = True) -> ReportContent:
    """A report whose levels are plain red, green and blue."""
    table = Table(f"Table of {name}", [name, "PSNR"], [(name, [(name, [Cell("1.00", "[0, 2]", name), Cell("2")])])])
    levels = [LevelImages(level, {name: data_uri(plain(colour), 48)}) for level, colour in COLOURS.items()]
    uri = data_uri(np.random.default_rng(0).random((max(noise, 8), max(noise, 8), 3)), max(noise, 8))
    return ReportContent(
        study=name,
        gamma=0.25,
        card=[Part("What was measured", [name], [table], [name]), Part(name, [name], [], [])],
        seen=[name],
        strips=[Strip(name, levels)],
        avatars={name: AVATAR_PAGE},
        charts={},
        figures=[Figure(name, name, uri)] * figures,
        tables=Document([name], [table], {name: 0}, [name]),
        skipped=[name],
        settings={name: name},
    )
