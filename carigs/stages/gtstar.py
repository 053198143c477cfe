"""Stage `gtstar`: every training frame turned into its caricature, with the reasons against its pixels."""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path

import numpy as np
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.images import write_bits, write_png
from carigs.files import writing, writing_folder
from carigs.head import pose
from carigs.settings import Gtstar
from carigs.surface import GammaPath
from carigs.target import Reason, face_reasons, make_target


def gtstar(settings: Gtstar, *, capture: Path, path: Path, targets: Path, index: Path) -> None:
    """Write the folder `targets` (colours, reasons of pixels and of faces) and `index`: how often each reason holds."""
    subject, gamma_path = Capture.load(capture), GammaPath.load(path)
    displacement = gamma_path.displacement(gamma_path.gamma_f)
    of_faces = face_reasons(subject.model, settings)
    entries = []
    with writing_folder(targets) as part:
        np.save(part / "faces.npy", of_faces)
        frames = subject.split("train")
        timesteps = groupby(frames, key=lambda frame: frame.timestep)
        count = len({frame.timestep for frame in frames})
        for timestep, group in track(timesteps, total=count, description="GT*", disable=count < 10):
            parameters = subject.parameters(timestep)
            natural, caricature = pose(subject.model, parameters), pose(subject.model, parameters, displacement)
            for frame in group:
                target = make_target(
                    subject.image(frame), subject.mask(frame), natural, caricature, subject.cameras[frame.camera],
                    subject.model, of_faces, settings, subject.background,
                )  # fmt: skip
                write_png(part / f"{frame.name}.png", target.colour)
                write_bits(part / f"{frame.name}_reasons.png", target.reasons)
                shares = {
                    reason.name.lower(): round(float(np.mean((target.reasons & reason.value) > 0)), 6)
                    for reason in Reason
                }
                entries.append({"timestep": timestep, "camera": frame.camera, "image": f"{frame.name}.png",
                                "reasons": f"{frame.name}_reasons.png", "shares": shares})  # fmt: skip
    with writing(index) as part_index:
        part_index.write_text(json.dumps({"gamma": gamma_path.gamma_f, "targets": entries}, indent=1))
