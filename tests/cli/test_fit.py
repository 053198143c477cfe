"""`carigs fit`: footage in, a dataset out that `read_dataset` accepts and that has the true head."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.cli.main import main
from carigs.fitting.landmark_files import Landmarks
from carigs.head import pose


@pytest.fixture
def ball(tmp_path) -> Path:
    """The miniature capture, with landmarks and their embedding."""
    folder = write_ball(tmp_path / "ball")
    capture = read_dataset(folder, folder / "head_model.npz")
    vertices = np.flatnonzero(capture.model.v_template[:, 2] > 0.05)[::7]
    timesteps, cameras = sorted(capture.parameter_files), sorted(capture.cameras)
    values = np.ones((len(timesteps), len(cameras), len(vertices), 3))
    for (t, c), frame in capture.frame_at.items():
        values[t, c, :, :2] = capture.camera(frame).project(pose(capture.model, capture.parameters(t))[vertices])[0]
    Landmarks(values, np.array(timesteps), np.array(cameras)).save(folder / "landmarks.npz")
    np.savez(folder / "embedding.npz", vertices=vertices)
    return folder


def fit(ball: Path, output: Path, *options: str) -> int:
    files = {"--head-model": "head_model.npz", "--landmarks": "landmarks.npz", "--embedding": "embedding.npz"}
    named = [part for option, name in files.items() for part in (option, str(ball / name))]
    return main(["fit", str(ball), *named, "-o", str(output), *options])


def vertex_errors(folder: Path, ball: Path) -> np.ndarray:
    """Millimetres of all vertices in all timesteps."""
    found, truth = (read_dataset(f, ball / "head_model.npz") for f in (folder, ball))
    pairs = [(pose(c.model, c.parameters(t)) for c in (found, truth)) for t in truth.parameter_files]
    return np.array([1000 * np.linalg.norm(a - b, axis=1) for a, b in pairs])


@pytest.mark.parametrize("options", [(), ("--no-refine",)])
def test_the_dataset_has_the_true_head(ball, tmp_path, options, capsys):
    without = {"flame_param_path", "fg_mask_path"} if options else {"flame_param_path"}
    for file in ball.glob("transforms_*.json"):
        content = json.loads(file.read_text())
        content["frames"] = [{k: v for k, v in f.items() if k not in without} for f in content["frames"]]
        file.write_text(json.dumps(content))
    assert fit(ball, tmp_path / "fitted", *options) == 0
    assert "median per camera in pixels: 0: 0." in capsys.readouterr().out
    written = json.loads((tmp_path / "fitted/transforms_train.json").read_text())["frames"]
    assert written[0]["file_path"].startswith("../ball/images/")
    shutil.copytree(ball / "flame_param", tmp_path / "truth")
    found = read_dataset(tmp_path / "fitted", ball / "head_model.npz")
    for timestep in found.parameter_files:
        truth = type(found.parameters(timestep)).load(tmp_path / f"truth/{timestep:05d}.npz", found.model)
        distance = np.linalg.norm(pose(found.model, found.parameters(timestep)) - pose(found.model, truth), axis=1)
        assert 1000 * distance.mean() < (0.3 if options else 1.0)  # a pixel is 6.7 mm


def test_images_that_lie_elsewhere_are_linked(ball, tmp_path):
    assert fit(ball, tmp_path / "far/away/fitted", "--no-refine") == 0
    frame = json.loads((tmp_path / "far/away/fitted/transforms_train.json").read_text())["frames"][0]
    link = tmp_path / "far/away/fitted" / frame["file_path"]
    assert link.is_symlink() and link.samefile(ball / "images/00000_00.png")
    assert vertex_errors(tmp_path / "far/away/fitted", ball).mean() < 0.3


def test_a_camera_that_stands_out_is_named(ball, tmp_path, capsys):
    with np.load(ball / "landmarks.npz") as content:
        arrays = dict(content)
    arrays["landmarks"][:, 2, :, 1] += 12  # as if cy of camera 2 were wrong: off the epipolar lines of the others
    np.savez(ball / "landmarks.npz", **arrays)
    fit(ball, tmp_path / "fitted", "--no-refine")
    assert re.search(r"warning: camera 2: landmarks are \d+\.\d pixels off", capsys.readouterr().err)


def test_timesteps_without_landmarks_are_named(ball, tmp_path, capsys):
    with np.load(ball / "landmarks.npz") as content:
        arrays = dict(content)
    arrays["landmarks"][1] = np.nan
    np.savez(ball / "landmarks.npz", **arrays)
    fit(ball, tmp_path / "fitted", "--no-refine")
    assert "in 1 timesteps, which follow their neighbours: 1" in capsys.readouterr().err


def test_bad_input_is_one_line_and_nothing_is_written(ball, tmp_path, capsys):
    with np.load(ball / "landmarks.npz") as content:
        arrays = dict(content)
    np.savez(ball / "landmarks.npz", **arrays | {"timesteps": arrays["timesteps"] + 100})
    assert fit(ball, tmp_path / "fitted") == 1
    assert "holds no landmarks for any frame" in capsys.readouterr().err
    np.savez(ball / "landmarks.npz", **arrays | {"landmarks": arrays["landmarks"] * (np.arange(3) < 1)[:, None, None]})
    assert fit(ball, tmp_path / "fitted") == 1
    assert "in no timestep do two cameras see 4 landmarks" in capsys.readouterr().err
    assert not (tmp_path / "fitted").exists()
    assert fit(ball, ball) == 1
    assert "is not empty; nothing is overwritten" in capsys.readouterr().err
    assert fit(ball, ball / "images") == 1
    assert "is not empty; nothing is overwritten" in capsys.readouterr().err
