"""The page of a report: one HTML file that asks for nothing from any network.

Names and messages are escaped by the template. A policy in the page (Content Security Policy, W3C) allows the one
script and style sheet by their digests, and images in the page alone.
"""

from __future__ import annotations

import base64
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, StrictUndefined

from carigs.errors import CarigsWarning
from evaluation.card.document import Part
from evaluation.report import training_chart
from evaluation.report.training_chart import Chart
from evaluation.tables.document import Document

SCALES = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Sizes of the images that are tried, until the page is small enough."""


class LevelImages(NamedTuple):
    """Images of one subject at one level."""

    level: str
    images: Mapping[str, str]
    """Data URIs by variant; `truth` is the true image."""


class Strip(NamedTuple):
    """Images of one subject in ascending order of the level."""

    subject: str
    levels: Sequence[LevelImages]


class Figure(NamedTuple):
    """A figure of the study."""

    file: str
    """Name below the folder of figures."""
    caption: str
    uri: str


@dataclass
class ReportContent:
    """Content of the page."""

    study: str
    gamma: float
    card: Sequence[Part]
    seen: Sequence[str]
    """What training frames see of each subject, and how far the head poses of its test frames lie from theirs."""
    strips: Sequence[Strip]
    avatars: Mapping[str, str]
    """Address of the page of each subject's avatar, relative to the report."""
    charts: Mapping[str, Chart]
    """Training of each subject."""
    figures: Sequence[Figure]
    tables: Document
    skipped: Sequence[str]
    """What was left out, and why."""
    settings: Mapping[str, str]
    """Text of the settings by their place."""


def report_page(report: ReportContent) -> str:
    """Write a report as HTML.

    Args:
        report: The content.

    Returns:
        The page.
    """
    here = Path(__file__)
    template, style, script = (
        here.with_name(name).read_text("utf-8") for name in ("page.html.jinja", "page.css", "page.js")
    )
    policy = (
        f"default-src 'none'; img-src data:; style-src {_digest(style)}; script-src {_digest(script)}; "
        "base-uri 'none'; form-action 'none'"
    )
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    return environment.from_string(template).render(
        title=f"carigs: study {report.study}, trained for level {report.gamma:g}",
        report=report,
        policy=policy,
        style=style,
        script=script,
        mean_of=training_chart.MEAN_OF,
        **{
            name.lower(): getattr(training_chart, name)
            for name in ("WIDTH", "HEIGHT", "LEFT", "RIGHT", "TOP", "BOTTOM")
        },
    )


def page_within(max_bytes: float, make: Callable[[float, bool], ReportContent]) -> str:
    """Write a report whose images are as large as its size allows.

    Args:
        max_bytes: Largest size of the page in bytes.
        make: Makes the content for a scale of the images, with or without the figures.

    Returns:
        The page.

    Warns:
        CarigsWarning: The page is larger, with the smallest images and no figures.
    """
    for with_figures in (True, False):
        for scale in SCALES:
            page = report_page(make(scale, with_figures))
            size = len(page.encode())
            if size <= max_bytes:
                return page
    problem = f"the report has {size / 1e6:.1f} MB without figures, more than {max_bytes / 1e6:g} MB"
    warnings.warn(problem, CarigsWarning, stacklevel=2)
    return page


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(sha256(text.encode()).digest()).decode()}'"
