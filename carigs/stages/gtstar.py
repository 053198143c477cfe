"""Stage `gtstar`: every training frame turned into its caricature, with the reasons against its pixels."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from itertools import groupby
from os.path import relpath
from pathlib import Path

import numpy as np
from rich.progress import Progress

from carigs.capture import Capture, Frame
from carigs.capture.images import read_bits, read_rgb, write_bits, write_png
from carigs.errors import InputError
from carigs.exaggeration import Caricature, GammaPath
from carigs.files import resuming_folder, writing
from carigs.gtstar import MaskFlag, face_mask_flags, flags_from_names
from carigs.gtstar.provider import Provided, check_settings, fitted_shading, input_files, provide
from carigs.light.fitting import load_shading, save_shading
from carigs.settings import DEFAULT_MASK_FLAGS, Gtstar
from carigs.sources import fingerprint
from evaluation.figures.target_sheet import TargetRow, target_sheet

SHOWN = 5
"""Frames on the contact sheet."""


def gtstar(settings: Gtstar, *, capture: Path, path: Path, level: float, targets: Path, index: Path) -> None:
    """Write the folder `targets` of a level (colours, reasons of pixels and of faces, a contact sheet) and `index`.

    The index says how often each reason holds, how far each frame is off its mesh and what it counts for, and which
    frames were left out.  A run that was killed is gone on with, timestep by timestep, to the same bytes.
    """
    check_settings(settings)
    subject, gamma_path = Capture.load(capture), GammaPath.load(path)
    exaggerated = gamma_path.at(level)
    of_faces = face_mask_flags(subject.model, settings)
    frames = subject.split("train")
    key = _key(settings, subject, exaggerated, capture)
    with resuming_folder(targets, key) as (folder, notes), _threads(settings.threads) as pool:
        np.save(folder / "faces.npy", of_faces)
        shading = load_shading(notes / "shading.npz")
        if shading is None:
            shading = fitted_shading(settings, subject, of_faces, pool.map)
            if shading is not None:
                with writing(notes / "shading.npz") as part:
                    save_shading(part, shading)
        if settings.relight == "targets_and_surfels" and shading is not None:
            save_shading(folder / "shading.npz", shading)

        def work(group: list[Frame]) -> tuple[dict, bool]:
            """What the index says of a timestep's frames, written with its images or found from an earlier run."""
            note = notes / f"{group[0].timestep:05d}.json"
            if note.is_file():
                return json.loads(note.read_text()), True
            provided = provide(settings, subject, of_faces, exaggerated, shading, group)
            content = _write(folder, provided)
            with writing(note) as part:
                part.write_text(json.dumps(content))
            return content, False

        content = {"level": level, "folder": relpath(targets, index.parent), "targets": [], "left_out": []}
        groups = [list(group) for _, group in groupby(frames, key=lambda frame: frame.timestep)]
        kept = 0
        with Progress(disable=len(frames) < 100) as progress:
            bar = progress.add_task("GT*", total=len(frames))
            for group, (found, earlier) in zip(groups, pool.map(work, groups), strict=True):
                content["targets"] += found["targets"]
                content["left_out"] += found["left_out"]
                kept += len(group) * earlier
                progress.advance(bar, len(group))
        if kept:
            print(f"GT*: {kept} of {len(frames)} frames were whole from a run before")
        _report(content, len(frames), capture)
        _write_sheet(folder, subject, content["targets"], exaggerated)
        with writing(index) as part:
            part.write_text(json.dumps(content, indent=1))


@contextmanager
def _threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """What waits is not begun any more once something failed."""
    pool = ThreadPoolExecutor(count)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _key(settings: Gtstar, subject: Capture, exaggerated: Caricature, capture: Path) -> str:
    """Digest of all that the targets depend on."""
    digest = hashlib.sha256(fingerprint("carigs.stages.gtstar").encode())
    digest.update(json.dumps({k: v for k, v in asdict(settings).items() if k != "threads"}).encode())
    digest.update(hashlib.sha256(capture.read_bytes()).digest())
    for array in vars(exaggerated).values():
        digest.update(b"none" if array is None else np.ascontiguousarray(array).tobytes())
    for file in input_files(settings, subject):
        status = file.stat() if file.is_file() else None
        size, changed = (status.st_size, status.st_mtime_ns) if status else (-1, -1)
        digest.update(f"{file} {size} {changed}".encode())
    return digest.hexdigest()


def _write(folder: Path, provided: list[Provided]) -> dict[str, list]:
    """Write the images of one timestep; returns what the index says of them."""
    content = {"targets": [], "left_out": []}
    for item in provided:
        name = item.frame.name
        off = None if item.misfit is None else round(item.misfit.pixels, 3)
        which = {"timestep": item.frame.timestep, "camera": item.frame.camera, "pixels_off": off}
        if item.target is None:
            content["left_out"].append({**which, "why": item.left_out})
            continue
        files = {"image": f"{name}.png", "reasons": f"{name}_reasons.png"}
        write_png(folder / files["image"], item.target.colour)
        write_bits(folder / files["reasons"], item.target.reasons)
        weight = {"weight": round(item.weight, 4)}
        content["targets"].append({**which, **weight, **files, "shares": _shares(item.target.reasons)})
    return content


def _report(content: dict, count: int, capture: Path) -> None:
    """Say which frames are left out or count for less; raises `InputError` if none is left."""
    for entry in content["left_out"]:
        print(f"GT*: frame {entry['timestep']:05d}_{entry['camera']:02d} is left out: {entry['why']}")
    if content["left_out"]:
        print(f"GT*: {len(content['left_out'])} of {count} frames are left out")
    if not content["targets"]:
        raise InputError(f"no frame can be used; the first: {content['left_out'][0]['why']}", file=capture)
    light = [entry for entry in content["targets"] if entry["weight"] < 1]
    for entry in light:
        name = Path(entry["image"]).stem
        print(f"GT*: frame {name} is {entry['pixels_off']:.1f} pixels off the others: it counts {entry['weight']:.2f}")
    if light:
        print(f"GT*: {len(light)} of {count} frames count for less")


def _write_sheet(folder: Path, subject: Capture, entries: list[dict], exaggerated: Caricature) -> None:
    """The contact sheet, from the written images; the procedural person's true caricature is rendered for it."""
    frames = subject.split("train")
    chosen = {frames[i].name: frames[i] for i in np.linspace(0, len(frames) - 1, SHOWN).astype(int)}
    person = None
    if (subject.root / "subject.npz").is_file():
        from carigs.toy import load_subject, render_subject

        person = load_subject(subject.root)
    shown = []
    for entry in entries:
        frame, truth = chosen.get(Path(entry["image"]).stem), None
        if frame is None:
            continue
        if person is not None:
            parameters, camera = subject.parameters(frame.timestep), subject.cameras[frame.camera]
            truth, _ = render_subject(person, parameters, camera, exaggerated)
        target, reasons = read_rgb(folder / entry["image"]), read_bits(folder / entry["reasons"])
        shown.append(TargetRow(frame.name, subject.image(frame), target, reasons, truth))
    if shown:
        target_sheet(folder / "inspection.png", shown, flags_from_names(DEFAULT_MASK_FLAGS))


def _shares(reasons: np.ndarray) -> dict[str, float]:
    """Of the image's pixels, for each reason."""
    return {reason.name.lower(): round(float(np.mean((reasons & reason.value) > 0)), 6) for reason in MaskFlag}
