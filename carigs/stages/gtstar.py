"""Stage `gtstar`: every training frame warped to its caricature, with its validity mask."""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path

import numpy as np
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.images import write_png
from carigs.files import writing, writing_folder
from carigs.head import pose
from carigs.settings import Gtstar
from carigs.surface import GammaPath
from carigs.target import frozen_faces, validity, warp_frame


def gtstar(settings: Gtstar, *, capture: Path, path: Path, targets: Path, index: Path) -> None:
    """Write the folder `targets` (colours, masks, frozen faces) and `index`, which says how much of each is trusted."""
    subject, gamma_path = Capture.load(capture), GammaPath.load(path)
    exaggerated = gamma_path.at(gamma_path.gamma_f)
    entries = []
    with writing_folder(targets) as part:
        np.save(part / "frozen.npy", frozen_faces(subject.model, settings))
        frames = subject.split("train")
        timesteps = groupby(frames, key=lambda frame: frame.timestep)
        count = len({frame.timestep for frame in frames})
        for timestep, group in track(timesteps, total=count, description="GT*", disable=count < 10):
            parameters = subject.parameters(timestep)
            natural, caricature = pose(subject.model, parameters), pose(subject.model, parameters, exaggerated)
            for frame in group:
                warp = warp_frame(
                    subject.image(frame),
                    natural,
                    caricature,
                    subject.model.faces,
                    subject.cameras[frame.camera],
                    subject.background,
                )
                judged = validity(warp, subject.mask(frame), subject.model, settings)
                write_png(part / f"{frame.name}.png", warp.colour)
                write_png(part / f"{frame.name}_mask.png", judged.valid.astype(np.float32))
                shares = {
                    name: round(float(getattr(judged, name).mean()), 6)
                    for name in ("valid", "invisible", "hair", "region", "outside")
                }
                entries.append({"timestep": frame.timestep, "camera": frame.camera, "image": f"{frame.name}.png",
                                "mask": f"{frame.name}_mask.png", **shares})  # fmt: skip
    with writing(index) as part_index:
        part_index.write_text(json.dumps({"gamma": gamma_path.gamma_f, "targets": entries}, indent=1))
