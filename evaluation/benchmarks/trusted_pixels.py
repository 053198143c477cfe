"""Error of the pixels that GT* frames trust: warped test frames against true caricatures, by region of the skin.

Measured twice: as if nothing covered the head, and with what the stage `hair` has found.

Example:
    python -m evaluation.benchmarks.trusted_pixels trusted.csv results/ict_s7/ict_s7/gamma=0.25
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Capture, Frame
from carigs.capture.frame_index import GroundTruth, read_ground_truth
from carigs.capture.images import read_rgb
from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.gtstar import face_mask_flags, flags_from_names
from carigs.gtstar.capture_shading import fit_capture_shading
from carigs.gtstar.provider import provide_targets
from carigs.hair import CarriedHair, FoundHair, load_hair
from carigs.head import neutral, read_subject_path
from carigs.settings import Gtstar, Train
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run
from evaluation.metrics.image_quality import psnr_of_errors
from evaluation.metrics.regions import surface_regions

ERROR_THRESHOLD = 0.15
"""Mean absolute difference of the channels above which a pixel counts as wrong."""


class Pixels(NamedTuple):
    """Pixels of a region in all frames."""

    squared_error: Float[np.ndarray, " n"]
    wrong: Bool[np.ndarray, " n"]
    """Off by more than `ERROR_THRESHOLD`."""
    kept: Bool[np.ndarray, " n"]
    """Without a flag that training leaves out."""


def skin_regions(capture: Capture, covered: Bool[np.ndarray, " f"]) -> dict[str, Bool[np.ndarray, " f"]]:
    """Triangles of parts of the skin.

    Args:
        capture: The capture.
        covered: Triangles that something covers.

    Returns:
        Triangles by name; without the parts that the head model does not name.
    """
    model = capture.model
    skin = surface_regions(model, neutral(model, capture.parameters(capture.frames[0].timestep))).faces
    named = {"forehead": ("forehead",), "ears": ("left_ear", "right_ear"), "bare neck": ("neck",)}
    known = {name: masks for name, masks in named.items() if set(masks) <= set(model.regions)}
    regions = {name: skin[name] for name in ("face", "skin") if name in skin}
    regions |= {name: model.face_region(*masks) for name, masks in known.items()}
    return {name: inside & ~covered if name == "bare neck" else inside for name, inside in regions.items()}


def warped_pixels(
    settings: Gtstar,
    mask_flags: Sequence[str],
    capture: Capture,
    caricature: Caricature,
    truth: GroundTruth,
    hair: FoundHair | None,
    regions: Mapping[str, Bool[np.ndarray, " f"]],
) -> dict[str, Pixels]:
    """Warp and relight the test frames that have a true caricature, as the stage `gtstar` does with training frames.

    Args:
        settings: Settings of the targets.
        mask_flags: Flags whose pixels training leaves out.
        capture: The capture.
        caricature: The caricature.
        truth: Its true images.
        hair: What covers the head; None as if nothing did.
        regions: Triangles by name.

    Returns:
        Pixels by region.
    """
    model, excluded = capture.model, flags_from_names(mask_flags).value
    covered = clean = carried = None
    if hair is not None:
        covered, clean, carried = hair.covered, hair.clean, _carried(hair, capture)
    face_flags = face_mask_flags(model, settings, covered)
    shading = fit_capture_shading(settings, capture, face_flags, map, {}, clean=clean)
    frames: list[Frame] = [f for f in capture.split("test") if (f.timestep, f.camera) in truth.images]
    parts: dict[str, list[Pixels]] = {region: [] for region in regions}
    for _, group in groupby(frames, key=lambda frame: frame.timestep):
        for frame, target, *_ in provide_targets(
            settings, capture, face_flags, caricature, shading, list(group), None, carried
        ):
            if target is None:
                continue
            difference = target.colour - read_rgb(truth.images[frame.timestep, frame.camera])
            squared, wrong = (difference**2).mean(axis=2), np.abs(difference).mean(axis=2) > ERROR_THRESHOLD
            kept, face = (target.mask_flags & excluded) == 0, target.caricature.fragments.face
            for region, triangles in regions.items():
                inside = (face >= 0) & triangles[face]
                parts[region].append(Pixels(squared[inside], wrong[inside], kept[inside]))
    return {region: Pixels(*map(np.concatenate, zip(*each, strict=True))) for region, each in parts.items() if each}


def _carried(hair: FoundHair, capture: Capture) -> CarriedHair:
    model, settings = capture.model, Gtstar()
    canonical = neutral(model, capture.parameters(capture.split("train")[0].timestep))
    scalp = model.face_region(*settings.regions.hair)
    return CarriedHair(hair, scalp, canonical, model.faces, settings.hair_extinction)


def measure(folder: Path) -> Iterator[Measurement]:
    """Measure a subject of a study, with default settings.

    Args:
        folder: Results of the subject at its gamma: `results/STUDY/SUBJECT/gamma=GAMMA`.

    Yields:
        PSNR of the kept pixels (nan if there are none), share of the pixels that is kept, and share of the wrong ones
        that is left out. The references are those of targets as if nothing covered the head.

    Raises:
        InputError: If there are no true caricatures.
    """
    capture = Capture.load(folder.parent / "capture.json")
    path = read_subject_path(folder / "path.npz", capture.model)
    hair = load_hair(folder.parent / "hair.npz", len(capture.model.faces))
    index = folder / f"truth/level={path.gamma_f:g}/truth.json"
    truth = read_ground_truth(index)
    if not truth.images:
        raise InputError("no true caricatures", file=index)
    regions = skin_regions(capture, hair.covered)
    common = Gtstar(), Train().mask_flags, capture, path.at(path.gamma_f), truth
    bare, found = (warped_pixels(*common, known, regions) for known in (None, hair))
    for region in (region for region in regions if region in found):
        case = f"{folder.parent.name}, {region}"
        before, after = bare[region], found[region]
        values = (psnr_of_errors(pixels.squared_error[pixels.kept]) for pixels in (after, before))
        yield Measurement(case, "PSNR of kept pixels", "dB", *values)
        yield Measurement(case, "share that is kept", "1", after.kept.mean(), before.kept.mean())
        if after.wrong.any() and before.wrong.any():
            caught = (1 - pixels.kept[pixels.wrong].mean() for pixels in (after, before))
            yield Measurement(case, f"share of pixels off by {ERROR_THRESHOLD} that is left out", "1", *caught)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("folder", type=Path, help="results/STUDY/SUBJECT/gamma=GAMMA, with true caricatures")
    task = parser.parse_args()
    write_measurements(task.rows, measure(task.folder))


if __name__ == "__main__":
    run(main)
