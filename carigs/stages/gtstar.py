"""Stage `gtstar`: every training frame turned into its caricature, with the reasons against its pixels."""

from __future__ import annotations

import json
from os.path import relpath
from pathlib import Path

import numpy as np
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.images import write_bits, write_png
from carigs.errors import InputError
from carigs.files import writing, writing_folder
from carigs.settings import EXCLUDED, Gtstar
from carigs.surface import Caricature, GammaPath
from carigs.target import Reason, as_bits, face_reasons
from carigs.target.light import save_shading
from carigs.target.provider import Provided, check_settings, fitted_shading, provide
from evaluation.target_sheet import Shown, target_sheet

SHOWN = 5
"""Frames on the contact sheet."""


def gtstar(settings: Gtstar, *, capture: Path, path: Path, level: float, targets: Path, index: Path) -> None:
    """Write the folder `targets` of a level (colours, reasons of pixels and of faces, a contact sheet) and `index`.

    The index says how often each reason holds, how far each frame is off its mesh, and which frames were left out.
    """
    check_settings(settings)
    subject, gamma_path = Capture.load(capture), GammaPath.load(path)
    exaggerated = gamma_path.at(level)
    of_faces = face_reasons(subject.model, settings)
    entries, left_out, shown = [], [], []
    frames = subject.split("train")
    count = len(frames)
    chosen = {frames[i] for i in np.linspace(0, count - 1, SHOWN).astype(int)}
    with writing_folder(targets) as part:
        np.save(part / "faces.npy", of_faces)
        shading = fitted_shading(settings, subject, of_faces)
        if settings.relight == "targets_and_surfels" and shading is not None:
            save_shading(part / "shading.npz", shading)
        provided = provide(settings, subject, of_faces, exaggerated, shading)
        for item in track(provided, total=count, description="GT*", disable=count < 100):
            if item.target is not None and len(shown) < SHOWN and item.frame in chosen:
                shown.append(_shown(subject, item, exaggerated))
            if item.target is None:
                print(f"GT*: frame {item.frame.name} is left out: {item.left_out}")
                left_out.append({**_which(item), "why": item.left_out})
                continue
            name = item.frame.name
            write_png(part / f"{name}.png", item.target.colour)
            write_bits(part / f"{name}_reasons.png", item.target.reasons)
            files = {"image": f"{name}.png", "reasons": f"{name}_reasons.png"}
            entries.append({**_which(item), **files, "shares": _shares(item.target.reasons)})
        if left_out:
            print(f"GT*: {len(left_out)} of {count} frames are left out")
        if not entries:
            raise InputError(f"no frame can be used; the first: {left_out[0]['why']}", file=capture)
        if shown:
            target_sheet(part / "inspection.png", shown, as_bits(EXCLUDED))
    content = {"level": level, "folder": relpath(targets, index.parent), "targets": entries, "left_out": left_out}
    with writing(index) as part_index:
        part_index.write_text(json.dumps(content, indent=1))


def _shown(subject: Capture, item: Provided, exaggerated: Caricature) -> Shown:
    """The row of the contact sheet; the procedural person's true caricature is rendered for it."""
    frame, truth = item.frame, None
    if (subject.root / "subject.npz").is_file():
        from carigs.capture.toy import load_subject, render_subject

        camera = subject.cameras[frame.camera]
        parameters = subject.parameters(frame.timestep)
        truth, _ = render_subject(load_subject(subject.root), parameters, camera, exaggerated)
    return Shown(frame.name, subject.image(frame), item.target.colour, item.target.reasons, truth)


def _which(item: Provided) -> dict[str, object]:
    off = None if item.misfit is None else round(item.misfit.pixels, 3)
    return {"timestep": item.frame.timestep, "camera": item.frame.camera, "pixels_off": off}


def _shares(reasons: np.ndarray) -> dict[str, float]:
    """Of the image's pixels, for each reason."""
    return {reason.name.lower(): round(float(np.mean((reasons & reason.value) > 0)), 6) for reason in Reason}
