"""Indexes of rendered frames, ground truth and GT* frames: round trips."""

import json

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.frame_index import (
    ground_truth_files,
    read_frame_index,
    read_ground_truth,
    write_frame_index,
    write_ground_truth,
)
from carigs.capture.target_index import FACE_FLAGS, read_targets, write_targets
from carigs.errors import InputError


def test_rendered_frames_round_trip_in_order(tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    entries = []
    for protocol, timestep in (("test", 3), ("orbit", 3), ("test", 2)):
        name = f"{protocol}_{timestep}.png"
        (frames / name).touch()
        entries.append({"protocol": protocol, "timestep": timestep, "camera": 1, "sequence": "EXP-2", "file": name})
    index = frames / "frames.json"
    write_frame_index(index, entries)
    rendered = read_frame_index(index)
    assert [(r.protocol, r.timestep, r.camera, r.order) for r in rendered] == [
        ("orbit", 3, 1, 1), ("test", 3, 1, 0), ("test", 2, 1, 2),
    ]  # fmt: skip
    assert all(image.file.is_file() for image in rendered)
    index.write_text(index.read_text().replace("orbit_3.png", "..\\\\frames\\\\orbit_3.png"))  # written on Windows
    assert read_frame_index(index)[0].file.samefile(frames / "orbit_3.png")
    (frames / "test_2.png").unlink()
    with pytest.raises(InputError, match=r"frames\.json: \[2\]\.file: no such image"):
        read_frame_index(index)


def test_ground_truth_round_trips(tmp_path):
    for name in ground_truth_files(3, 1).values():
        (tmp_path / name).touch()
    write_ground_truth(tmp_path / "truth.json", 0.25, [(3, 1)])
    truth = read_ground_truth(tmp_path / "truth.json")
    assert truth.reason is None
    assert truth.images == {(3, 1): tmp_path / "00003_01.png"}
    assert truth.masks == {(3, 1): tmp_path / "00003_01_mask.png"}
    write_ground_truth(tmp_path / "truth.json", 0.25, [], "no true caricature")
    assert read_ground_truth(tmp_path / "truth.json").reason == "no true caricature"
    (tmp_path / "truth.json").write_text(json.dumps([]))
    with pytest.raises(InputError, match=r"truth\.json: expected an object"):
        read_ground_truth(tmp_path / "truth.json")
    (tmp_path / "truth.json").write_text(json.dumps({}))
    with pytest.raises(InputError, match=r"truth\.json: frames: "):
        read_ground_truth(tmp_path / "truth.json")


def test_targets_round_trip(tmp_path):
    root = write_ball(tmp_path / "ball")
    capture = read_dataset(root, root / "head_model.npz")
    frame, folder = capture.split("train")[0], tmp_path / "targets"
    folder.mkdir()
    flags = np.arange(len(capture.model.faces)).astype(np.uint16)
    np.save(folder / FACE_FLAGS, flags)
    entry = {"timestep": frame.timestep, "camera": frame.camera, "image": "a.png", "mask_flags": "b.png"}
    write_targets(tmp_path / "targets.json", 0.25, folder, [{**entry, "weight": 0.5}, entry], [])
    targets = read_targets(tmp_path / "targets.json", capture)
    np.testing.assert_array_equal(targets.face_flags, flags)
    assert [target.weight for target in targets.targets] == [0.5, 1.0]
    assert targets.targets[0][:4] == (frame, 0.25, folder / "a.png", folder / "b.png")
    np.save(folder / FACE_FLAGS, flags[1:])
    with pytest.raises(InputError, match=r"faces\.npy: uint16 .* expected 16 bits for each"):
        read_targets(tmp_path / "targets.json", capture)
