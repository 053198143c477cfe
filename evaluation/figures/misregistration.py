"""Error of GT* targets over the level: warped test frames against their true caricature (misregistration figure)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth
from carigs.capture.images import read_grey, read_rgb
from carigs.exaggeration import GammaPath
from carigs.gtstar import face_mask_flags, flags_from_names, make_target
from carigs.head import neutral, pose
from carigs.raster import compute_visibility
from carigs.settings import Gtstar
from evaluation.figures.png_figure import png_figure
from evaluation.figures.style import MARKERS, TEXT_WIDTH
from evaluation.metrics.regions import image_regions, surface_regions

REGIONS = ("face", "eyes", "brow", "neck_ear", "hair", "skin")
MAX_MASKED = 0.9
"""Share of masked pixels above which a region is not drawn. Hair is not warped: its error, that of the background in
its place, is the same at all levels."""
ERROR_THRESHOLD = 0.15
"""Mean absolute difference of the channels above which a pixel counts as wrong."""


class Misregistration(NamedTuple):
    """Error of the targets in one region at one level."""

    level: float
    region: str
    error: float
    """Mean absolute difference of all pixels of the region."""
    wrong: float
    """Share of these pixels that are wrong."""
    marked: float
    """Share of the wrong pixels that the mask leaves out."""
    masked: float
    """Share of all pixels of the region that the mask leaves out."""


def misregistrations(
    subject: Capture,
    path: GammaPath,
    truths: Mapping[float, GroundTruth],
    settings: Gtstar,
    mask_flags: Sequence[str],
    covered: Bool[np.ndarray, " f"] | None = None,
    cameras: int = 3,
) -> Iterator[Misregistration]:
    """Warp test frames to every level that has a truth, and compare; the targets are not relit.

    Args:
        subject: The capture.
        path: Caricature path of the subject.
        truths: True images, by level.
        settings: Settings of the warp and its masks (stage `gtstar`).
        mask_flags: Names of the flags whose pixels the training leaves out (`train.mask_flags`).
        covered: Triangles that something covers; none if None.
        cameras: Number of cameras: the first ones that have true images.

    Yields:
        One record per level and region.
    """
    model, excluded = subject.model, np.uint16(flags_from_names(mask_flags).value)
    face_flags = face_mask_flags(model, settings, covered)
    for level, truth in truths.items():
        frames = [f for f in subject.split("test") if (f.timestep, f.camera) in truth.images]
        shown_cameras = sorted({f.camera for f in frames})[:cameras]
        pooled: dict[str, list[np.ndarray]] = {region: [] for region in REGIONS}
        for frame in (f for f in frames if f.camera in shown_cameras):
            parameters, camera = subject.parameters(frame.timestep), subject.camera(frame)
            natural, caricature = pose(model, parameters), pose(model, parameters, path.at(level))
            ends = [compute_visibility(vertices, model.faces, camera) for vertices in (natural, caricature)]
            images = subject.image(frame), subject.foreground(frame)
            target = make_target(*images, *ends, model, face_flags, settings, subject.background)
            key = (frame.timestep, frame.camera)
            error = np.abs(target.colour - read_rgb(truth.images[key])).mean(axis=2)
            surface = surface_regions(model, neutral(model, parameters))
            foreground = read_grey(truth.masks[key]) > 0.5
            regions = image_regions(surface, caricature, target.caricature.fragments, camera, foreground, band=2)
            masked = (target.mask_flags & excluded) > 0
            for region in regions.keys() & pooled.keys():
                pooled[region].append(np.stack([error[regions[region]], masked[regions[region]]]))
        for region, parts in pooled.items():
            if parts and (pixels := np.concatenate(parts, axis=1)).size:
                wrong = pixels[0] > ERROR_THRESHOLD
                marked = float(pixels[1][wrong].mean()) if wrong.any() else 1.0
                means = (float(pixels[0].mean()), float(wrong.mean()), marked, float(pixels[1].mean()))
                yield Misregistration(level, region, *means)


def plot_misregistrations(file: Path, records: Sequence[Misregistration]) -> None:
    """Draw mean error and share of wrong pixels against the level, one line per region that is not masked.

    Args:
        file: PNG file to write, with a PDF file beside it.
        records: Errors by level and region.
    """
    panels = {"error": "mean |target - truth|", "wrong": f"share of pixels off by > {ERROR_THRESHOLD:g}"}
    with png_figure(file, (TEXT_WIDTH, 2.5), dpi=200, vector=True) as figure:
        for axes, (name, label) in zip(figure.subplots(1, 2), panels.items(), strict=True):
            for region, marker in zip(REGIONS, MARKERS, strict=False):
                drawn = [record for record in records if record.region == region and record.masked <= MAX_MASKED]
                points = [(record.level, max(getattr(record, name), 1e-4)) for record in drawn]
                if points:
                    axes.plot(*zip(*points, strict=True), f"{marker}-", label=region.replace("_", " "))
            axes.set(yscale="log", xlabel=r"caricature level $\gamma$", ylabel=label)
            axes.grid()
        axes.legend()
