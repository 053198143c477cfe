"""How far targets are from the truth as the caricature grows: test frames, warped, against their true caricature."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth
from carigs.capture.images import read_grey, read_rgb
from carigs.exaggeration import GammaPath
from carigs.files import writing
from carigs.gtstar import face_mask_flags, flags_from_names, make_target
from carigs.head import neutral, pose
from carigs.raster import compute_visibility
from carigs.settings import DEFAULT_MASK_FLAGS, Gtstar
from evaluation.metrics.regions import image_regions, surface_regions

REGIONS = ("face", "eyes", "brow", "neck_ear", "hair", "skin")
LIMIT = 0.15
"""A pixel that differs more than this (mean of the channels) is wrong."""


class Misregistration(NamedTuple):
    """Of one region at one level."""

    level: float
    region: str
    error: float
    """Mean absolute difference of all its pixels."""
    wrong: float
    """Share of them that are wrong."""
    marked: float
    """Share of the wrong ones that some default reason leaves out."""


def misregistrations(
    subject: Capture, path: GammaPath, truths: Mapping[float, GroundTruth], cameras: int = 3
) -> Iterable[Misregistration]:
    """Rows of every level that has a truth, over its first `cameras` views: plain warps, in the old light."""
    model, settings, excluded = subject.model, Gtstar(), np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    of_faces = face_mask_flags(model, settings)
    for level, known in truths.items():
        frames = [f for f in subject.split("test") if (f.timestep, f.camera) in known.images]
        chosen = sorted({f.camera for f in frames})[:cameras]
        pooled: dict[str, list[np.ndarray]] = {region: [] for region in REGIONS}
        for frame in (f for f in frames if f.camera in chosen):
            parameters, camera = subject.parameters(frame.timestep), subject.cameras[frame.camera]
            caricature = pose(model, parameters, path.at(level))
            ends = [compute_visibility(v, model.faces, camera) for v in (pose(model, parameters), caricature)]
            pictures = subject.image(frame), subject.mask(frame)
            target = make_target(*pictures, *ends, model, of_faces, settings, subject.background)
            key = (frame.timestep, frame.camera)
            error = np.abs(target.colour - read_rgb(known.images[key])).mean(axis=2)
            surface = surface_regions(model, neutral(model, parameters))
            foreground = read_grey(known.masks[key]) > 0.5
            regions = image_regions(surface, caricature, target.caricature.fragments, camera, foreground, band=2)
            out = (target.mask_flags & excluded) > 0
            for region in pooled:
                if region in regions:
                    pooled[region].append(np.stack([error[regions[region]], out[regions[region]]]))
        for region, parts in pooled.items():
            if parts and (pixels := np.concatenate(parts, axis=1)).size:
                wrong = pixels[0] > LIMIT
                marked = float(pixels[1][wrong].mean()) if wrong.any() else 1.0
                yield Misregistration(level, region, float(pixels[0].mean()), float(wrong.mean()), marked)


def write_misregistrations(file: Path, rows: Iterable[Misregistration]) -> None:
    """As CSV."""
    with writing(file) as part, part.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(Misregistration._fields)
        writer.writerows([f"{row.level:g}", row.region, *(f"{value:.6g}" for value in row[2:])] for row in rows)


def plot_misregistrations(file: Path, rows: Iterable[Misregistration]) -> None:
    """Mean error and share of wrong pixels against the level, a line per region."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = list(rows)
    figure = Figure(figsize=(9.0, 3.6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, name, label in zip(
        figure.subplots(1, 2), ("error", "wrong"), ("mean |target - truth|", f"share of pixels off by > {LIMIT:g}"),
        strict=True,
    ):  # fmt: skip
        for region in REGIONS:
            points = [(row.level, max(getattr(row, name), 1e-4)) for row in rows if row.region == region]
            if points:
                axes.plot(*zip(*points, strict=True), "o-", markersize=3, label=region)
        axes.set_yscale("log")
        axes.set_xlabel(r"caricature level $\gamma$")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})
