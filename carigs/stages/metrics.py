"""Stage `metrics`: how close the rendered frames come to the truth, to the prompt, and to each other."""

from __future__ import annotations

from pathlib import Path

from carigs.capture import Capture
from carigs.capture.frame_index import read_rendered, read_truths
from carigs.exaggeration import GammaPath
from carigs.settings import Metrics
from evaluation.metrics.against_truth import compare
from evaluation.metrics.embeddings import embedding_rows
from evaluation.tables.rows import Scene, write_rows


def metrics(
    settings: Metrics,
    *,
    frames: Path,
    index: Path,
    capture: Path,
    path: Path,
    truth: Path,
    study: str,
    subject: str,
    variant: str,
    gamma: float,
    level: float,
    rows: Path,
) -> None:
    """Write `rows`: one line per frame, region and metric; null, with the reason, what cannot be measured."""
    scene = Scene(study, subject, variant, gamma, level)
    person, rendered, truths = Capture.load(capture), read_rendered(index, frames), read_truths(truth)
    caricature = GammaPath.load(path).at(level)
    measured = [
        *compare(scene, rendered, truths, person, caricature, band=settings.silhouette_band),
        *embedding_rows(scene, rendered, person, settings),
    ]
    write_rows(rows, measured)
