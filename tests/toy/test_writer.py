"""The procedural capture on disk: layout, splits, and images that are exactly what the parameters on disk give."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from carigs.capture import read_dataset
from carigs.capture.images import read_rgb8
from carigs.errors import InputError, SettingsError
from carigs.settings import Toy
from carigs.toy import load_subject, render_subject, write_capture
from carigs.toy.scene import frontal_camera, split_names, studio_cameras, timesteps

SETTINGS = Toy(
    width=40, height=52, cameras=3, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=200
)
SEQUENCES = {f"EMO-{i}" for i in range(1, 5)} | {f"EXP-{i}" for i in range(1, 7)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("toy") / "capture"
    write_capture(folder, SETTINGS)
    return folder


def test_layout(folder: Path) -> None:
    names = {f"{t:05d}_{c:02d}.png" for t in range(10) for c in range(3)}
    assert {file.name for file in (folder / "images").iterdir()} == names
    assert {file.name for file in (folder / "fg_masks").iterdir()} == names
    assert {file.name for file in (folder / "flame_param").iterdir()} == {f"{t:05d}.npz" for t in range(10)}
    with np.load(folder / "canonical_flame_param.npz") as canonical:
        assert canonical["jaw_pose"] == pytest.approx(np.array([[0.3, 0, 0]]))
        assert not canonical["expr"].any() and canonical["shape"].any() and canonical["static_offset"].ndim == 3
    frame = json.loads((folder / "transforms_train.json").read_text())["frames"][0]
    keys = (
        "timestep_index timestep_index_original timestep_id camera_index camera_id cx cy fl_x fl_y h w camera_angle_x"
    )
    keys += " camera_angle_y transform_matrix file_path fg_mask_path flame_param_path sequence"
    assert set(frame) == set(keys.split())
    assert frame["camera_angle_x"] == pytest.approx(2 * np.arctan(frame["w"] / 2 / frame["fl_x"]))


def test_splits(tmp_path: Path) -> None:
    write_capture(tmp_path, replace(SETTINGS, cameras=7))
    capture = read_dataset(tmp_path, tmp_path / "head_model.npz")
    assert len(capture.frames) == 70 and {frame.sequence for frame in capture.frames} == SEQUENCES
    assert {frame.sequence for frame in capture.split("test")} == {"EXP-2"}
    assert {frame.camera for frame in capture.split("test")} == {*range(7)}
    # The test sequence comes last, and the most frontal camera is held out of the others.
    assert min(f.timestep for f in capture.split("test")) > max(f.timestep for f in capture.split("train"))
    assert {frame.camera for frame in capture.split("val")} == {3}
    assert {frame.camera for frame in capture.split("train")} == {0, 1, 2, 4, 5, 6}
    facing = {c: -camera.camera_from_world[2, 2] for c, camera in capture.cameras.items()}
    assert max(facing, key=facing.get) == capture.validation_camera == 3
    content = json.loads((tmp_path / "transforms_val.json").read_text())
    assert content["camera_indices"] == [3] and content["timestep_indices"] == list(range(9))


@pytest.mark.parametrize("count", [1, 3, 5])
def test_few_cameras_all_train(count: int) -> None:
    settings = replace(SETTINGS, cameras=count, steps_per_sequence=3)
    cameras = studio_cameras(settings)
    names = split_names([step.sequence for step in timesteps(settings, np.zeros(300))], cameras)
    assert all(len(set(row)) == 1 for row in names)
    assert [row[0] for row in names].count("test") == 3 and 2 <= [row[0] for row in names].count("val") <= 3


def test_images_are_what_the_subject_on_disk_renders(folder: Path) -> None:
    capture, subject = read_dataset(folder, folder / "head_model.npz"), load_subject(folder)
    for frame in (capture.split("train")[3], capture.split("test")[1]):
        camera = capture.cameras[frame.camera]
        colour, alpha = render_subject(subject, capture.parameters(frame.timestep), camera)
        levels = read_rgb8(folder / frame.image).astype(int)
        # Cameras pass through their inverse on the way to disk: a sample may fall to the other side of an edge.
        assert (np.abs(levels - np.rint(colour * 255)).max(axis=2) > 1).mean() < 0.01
        assert (np.abs(capture.mask(frame) - alpha) > 0.01).mean() < 0.01


def test_equal_settings_give_equal_bytes(folder: Path, tmp_path: Path) -> None:
    write_capture(tmp_path / "again", SETTINGS)

    def digests(root: Path) -> dict[str, str]:
        files = sorted(file for file in root.rglob("*") if file.is_file())
        return {str(file.relative_to(root)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}

    assert digests(tmp_path / "again") == digests(folder)


def test_cameras_stand_on_a_frontal_cap_and_look_at_the_head() -> None:
    cameras = studio_cameras(Toy())
    assert len(cameras) >= 8
    distance = [np.linalg.norm(camera.centre) for camera in cameras]
    assert np.ptp(distance) < 0.05
    azimuth = np.degrees([np.arctan2(camera.centre[0], camera.centre[2]) for camera in cameras])
    assert azimuth.min() == pytest.approx(-50, abs=1) and azimuth.max() == pytest.approx(50, abs=1)
    assert (np.diff(azimuth) > 0).all() and len({round(camera.centre[1], 2) for camera in cameras}) >= 3
    for camera in cameras:
        pixel, depth = camera.project(np.array([[0.0, -0.01, 0.005]]))
        assert depth[0] > 0 and pixel[0] == pytest.approx([camera.width / 2, camera.height / 2], abs=1e-6)
    assert frontal_camera(cameras) == 4


def test_sequences_go_from_nearly_neutral_to_the_full_act() -> None:
    timeline = timesteps(replace(Toy(), steps_per_sequence=3), np.zeros(300))
    assert [step.sequence for step in timeline[-3:]] == ["EXP-2"] * 3 and len(timeline) == 30
    for i in range(0, 30, 3):
        strength = [
            np.abs(step.parameters.expression).sum() + np.abs(step.parameters.joints[1]).sum()
            for step in timeline[i : i + 3]
        ]
        assert strength[0] < 0.4 * strength[2] and strength == sorted(strength)
    turns = np.array([step.parameters.rotation for step in timeline])
    assert 0.02 < np.linalg.norm(turns, axis=1).max() < 0.3  # small head motion
    assert np.ptp([step.parameters.joints[2:] for step in timeline], axis=0)[:, :2].min() > 0.1  # gaze motion


def test_bad_settings_and_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"capture\.toy\.cameras=0"):
        write_capture(tmp_path, replace(SETTINGS, cameras=0))
    assert not any(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"head_model\.npz"):
        load_subject(tmp_path)
