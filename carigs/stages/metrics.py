"""Stage `metrics`: how close the rendered frames come to the truth, to the prompt, and to each other."""

from __future__ import annotations

from pathlib import Path

from carigs.capture import Capture
from carigs.capture.frame_index import read_frame_index, read_ground_truth
from carigs.errors import SettingsError
from carigs.exaggeration import GammaPath
from carigs.settings import Metrics
from evaluation.metrics.against_truth import compare
from evaluation.metrics.embeddings import WEIGHTS, embedding_rows
from evaluation.metrics.preprocessing import CROPS
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
    check_settings(settings)
    scene = Scene(study, subject, variant, gamma, level)
    person, rendered, truths = Capture.load(capture), read_frame_index(index, frames), read_ground_truth(truth)
    caricature = GammaPath.load(path).at(level)
    measured = [
        *compare(scene, rendered, truths, person, caricature, band=settings.silhouette_band),
        *embedding_rows(scene, rendered, person, settings),
    ]
    write_rows(rows, measured)


def check_settings(settings: Metrics) -> None:
    """Raise `SettingsError` for a value without meaning, before any work."""
    for name in settings.embeddings:
        if name not in WEIGHTS:
            raise SettingsError(f"metrics.embeddings: {name} is unknown; choose from {', '.join(WEIGHTS)}")
    if settings.crop not in CROPS:
        raise SettingsError(f"metrics.crop={settings.crop} is unknown; choose {' or '.join(CROPS)}")
    if settings.silhouette_band < 1:
        raise SettingsError(f"metrics.silhouette_band={settings.silhouette_band} must be at least 1 pixel")
