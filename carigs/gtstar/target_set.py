"""The targets of all training frames on disk, made timestep by timestep; an interrupted run can be resumed."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.progress import Progress

from carigs.capture import Capture, Frame
from carigs.capture.images import write_bits, write_png
from carigs.capture.target_index import FACE_FLAGS, SHADING
from carigs.exaggeration import Caricature
from carigs.gtstar.by_command import edit_by_command
from carigs.gtstar.by_exemplar import edit_by_exemplar
from carigs.gtstar.capture_shading import fit_capture_shading
from carigs.gtstar.frame_views import TimestepViews
from carigs.gtstar.mask_flags import MaskFlag, face_mask_flags
from carigs.gtstar.provider import TargetResult, provide_targets
from carigs.hair import CarriedHair, FoundHair
from carigs.head import neutral
from carigs.light.shading import load_shading, save_shading
from carigs.readers.json_files import read_json
from carigs.settings import Gtstar
from carigs.system.files import write_json, writing


class TargetEntries(NamedTuple):
    """The two lists of targets.json: what `write_targets` takes."""

    targets: list[dict[str, Any]]
    skipped: list[dict[str, Any]]


def make_target_set(
    settings: Gtstar,
    capture: Capture,
    exaggerated: Caricature,
    folder: Path,
    records: Path,
    hair: FoundHair | None = None,
    threads: int = 1,
    level: float | None = None,
) -> TargetEntries:
    """Make the targets of all training frames of a level.

    Args:
        settings: Settings of the stage.
        capture: The capture.
        exaggerated: The caricature of the level.
        folder: Receives colours and mask flags of every frame, the flags of the triangles, and the light for training.
        records: Folder for what is complete; timesteps that an earlier run has recorded there are not made again.
        hair: What covers the head; None if nothing does.
        threads: Timesteps processed in parallel; the result does not depend on it.
        level: The level, for the program of the provider `command`.

    Returns:
        One entry for every training frame, in their order: in the list of targets or in that of skipped frames.
    """
    model, frames = capture.model, capture.split("train")
    if settings.provider == "command":
        edited = edit_by_command(settings, capture, exaggerated, records / "exchange", level)
        settings = replace(settings, provider="precomputed", folder=str(edited))
    elif settings.provider == "exemplar":
        edited = edit_by_exemplar(settings, capture, records / "painted")
        settings = replace(settings, provider="precomputed", folder=str(edited))
    covered = clean = carried_hair = None
    if hair is not None:
        covered, clean = hair.covered, hair.clean
        canonical = neutral(model, capture.parameters(frames[0].timestep))
        scalp = model.face_region(*settings.regions.hair)
        carried_hair = CarriedHair(hair, scalp, canonical, model.faces, settings.hair_extinction)
    face_flags = face_mask_flags(model, settings, covered)
    np.save(folder / FACE_FLAGS, face_flags)
    cache: dict[int, TimestepViews] = {}

    def make_timestep(group: list[Frame]) -> tuple[list[list], bool]:
        """Entries of a timestep, and whether an earlier run made it."""
        timestep = group[0].timestep
        record = records / f"{timestep:05d}.json"
        if record.is_file():
            return read_json(record), True
        views = cache.pop(timestep, None)
        targets = provide_targets(settings, capture, face_flags, exaggerated, shading, group, views, carried_hair)
        entries = _write(folder, targets)
        write_json(record, entries)
        return entries, False

    entries, resumed = TargetEntries([], []), 0
    groups = [list(group) for _, group in groupby(frames, key=lambda frame: frame.timestep)]
    with ThreadPoolExecutor(threads) as pool, Progress(disable=len(frames) < 100) as progress:
        shading = load_shading(records / SHADING, len(capture.model.faces))
        if shading is None:
            shading = fit_capture_shading(settings, capture, face_flags, pool.map, cache, clean=clean)
            if shading is not None:
                with writing(records / SHADING) as part:
                    save_shading(part, shading)
        if settings.relight == "targets_and_surfels" and shading is not None:
            save_shading(folder / SHADING, shading)
        bar = progress.add_task("GT*", total=len(frames))
        for group, ((targets, skipped), earlier) in zip(groups, pool.map(make_timestep, groups), strict=True):
            entries.targets.extend(targets)
            entries.skipped.extend(skipped)
            resumed += len(group) * earlier
            progress.advance(bar, len(group))
    if resumed:
        print(f"GT*: {resumed} of {len(frames)} frames were made by an earlier run")
    return entries


def _write(folder: Path, results: list[TargetResult]) -> TargetEntries:
    """Write the images of one timestep."""
    entries = TargetEntries([], [])
    for result in results:
        name, error = result.frame.name, result.registration_error
        pixels = None if error is None else round(error.pixels, 3)
        entry = {"timestep": result.frame.timestep, "camera": result.frame.camera, "pixels_off": pixels}
        if result.target is None:
            entries.skipped.append({**entry, "why": result.skip_reason})
            continue
        files, flags = {"image": f"{name}.png", "mask_flags": f"{name}_mask_flags.png"}, result.target.mask_flags
        write_png(folder / files["image"], result.target.colour)
        write_bits(folder / files["mask_flags"], flags)
        shares = {flag.name.lower(): round(float(np.mean((flags & flag.value) > 0)), 6) for flag in MaskFlag}
        entries.targets.append({**entry, "weight": round(result.weight, 4), **files, "shares": shares})
    return entries
