"""Rendered frames of the miniature ball, which are as they should be but for a constant."""

import json
import shutil

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.capture_json import camera_to_json
from carigs.capture.images import write_png
from carigs.capture.orbit import orbit_cameras
from carigs.exaggeration import straight_path
from carigs.head import neutral
from evaluation.tables.frame_records import FrameRecord, write_frame_records

DIFFERENCE = 20 / 255


@pytest.fixture
def no_weights(tmp_path, monkeypatch):
    """No folder in which networks would be found."""
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    for name in ("HF_HUB_CACHE", "CARIGS_WEIGHTS"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def scene(tmp_path, no_weights):
    """Keywords of the stage; every rendered pixel is brighter than its truth by DIFFERENCE."""
    read_dataset(write_ball(tmp_path / "ball"), tmp_path / "ball/head_model.npz").save(tmp_path / "capture.json")
    subject = Capture.load(tmp_path / "capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    straight_path(shape, subject.model.faces, 0.2 * shape, 0.25).save(tmp_path / "path.npz")
    frames, truths, random = [], [], np.random.default_rng(0)
    shown = tmp_path / "frames/level=0.25"
    for folder in (shown, tmp_path / "truth/frames"):
        folder.mkdir(parents=True)
    for frame in (*subject.split("test"), *subject.split("val")[:1]):
        image = random.integers(60, 140, (48, 40, 3)) / 255
        write_png(shown / f"{frame.name}.png", image + DIFFERENCE)
        write_png(tmp_path / "truth/frames" / f"{frame.name}.png", image)
        write_png(tmp_path / "truth/frames" / f"{frame.name}_mask.png", subject.mask(frame))
        key = {"timestep": frame.timestep, "camera": frame.camera}
        frames.append(
            {**key, "protocol": frame.split, "sequence": "", "file": f"{frame.name}.png", "order": len(frames)}
        )
        truths.append({**key, "image": f"{frame.name}.png", "mask": f"{frame.name}_mask.png"})
    for i, camera in enumerate(orbit_cameras(subject, 3, 20)):
        write_png(shown / f"orbit{i}.png", np.full((48, 40, 3), i / 3))
        entry = {"timestep": 3, "camera": i, "protocol": "orbit", "file": f"orbit{i}.png", "order": 9 + i}
        frames.append({**entry, "view": camera_to_json(camera)})
    geometry = FrameRecord("test", 0, 3, "full", "hole_rate", 0.125, "")
    write_frame_records(shown / "geometry.csv", [geometry])
    (shown / "frames.json").write_text(json.dumps(frames))
    shutil.copytree(shown, shown.with_name("level=0"))
    (tmp_path / "truth/truth.json").write_text(json.dumps({"level": 0.25, "reason": None, "frames": truths}))
    return {
        "frames": tmp_path / "frames", "capture": tmp_path / "capture.json", "path": tmp_path / "path.npz",
        "truths": [tmp_path / "truth/truth.json"], "records": tmp_path / "rows.csv",
        "embeddings": str(tmp_path / "embeddings"),
        "study": "s", "subject": "ball", "variant": "v", "seed": 0, "gamma": 0.25, "levels": [0.25],
    }  # fmt: skip
