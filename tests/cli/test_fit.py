"""`carigs fit`: footage in, a dataset out that `read_dataset` accepts and that has the true head."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from calibrations import write_cameras, write_colmap, write_images
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.images import read_grey, read_rgb, write_png
from carigs.cli.main import main
from carigs.fitting.landmarks.files import Landmarks
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


@pytest.fixture
def stated_order(monkeypatch):
    """Landmarks count as pixels in the stated order: the search for mistakes takes most of the time."""
    monkeypatch.setattr("carigs.fitting.video_fit.check_convention", lambda *_: None)


def vertex_errors(folder: Path, ball: Path) -> np.ndarray:
    """Millimetres of all vertices in all timesteps."""
    found, truth = (read_dataset(f, ball / "head_model.npz") for f in (folder, ball))
    pairs = [(pose(c.model, c.parameters(t)) for c in (found, truth)) for t in truth.parameter_files]
    return np.array([1000 * np.linalg.norm(a - b, axis=1) for a, b in pairs])


@pytest.mark.sample(1)
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


@pytest.mark.usefixtures("stated_order")
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


@pytest.mark.usefixtures("stated_order")
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


# Folders of images with a calibration.


@pytest.fixture
def folders(ball, tmp_path) -> Path:
    """The same capture as folders of images and mattes, without a calibration."""
    write_images(tmp_path / "own", read_dataset(ball, ball / "head_model.npz"))
    for name in ("head_model.npz", "landmarks.npz", "embedding.npz"):
        shutil.copyfile(ball / name, tmp_path / "own" / name)
    return tmp_path / "own"


@pytest.mark.sample(1)
@pytest.mark.usefixtures("stated_order")
@pytest.mark.parametrize("calibration", ["cameras.json", "COLMAP as text", "COLMAP as binary", "elsewhere"])
def test_folders_of_images_with_a_calibration(folders, ball, tmp_path, calibration):
    options = ["--no-refine", "--copy"]
    if calibration == "elsewhere":
        write_colmap(tmp_path / "colmap", binary=True, unit=2.5)
        options += ["--cameras", str(tmp_path / "colmap/sparse/0"), "--metres-per-unit", "2.5"]
    elif calibration == "cameras.json":
        write_cameras(folders)
    else:
        write_colmap(folders, binary=calibration.endswith("binary"))
    assert fit(folders, tmp_path / "fitted", *options) == 0
    assert vertex_errors(tmp_path / "fitted", ball).mean() < 0.3
    found, truth = (read_dataset(f, ball / "head_model.npz") for f in (tmp_path / "fitted", ball))
    for frame in found.frames:
        same = truth.frame_at[frame.timestep, frame.camera]
        np.testing.assert_array_equal(found.image(frame), truth.image(same))
        np.testing.assert_array_equal(found.mask(frame), truth.mask(same))
        np.testing.assert_allclose(
            found.camera(frame).camera_from_world, truth.camera(same).camera_from_world, atol=1e-9
        )
    assert not any(file.is_symlink() for file in (tmp_path / "fitted").rglob("*.png"))


@pytest.mark.usefixtures("stated_order")
def test_mattes_in_folders_are_used(folders, ball, tmp_path):
    write_cameras(folders)
    assert fit(folders, tmp_path / "fitted") == 0
    assert vertex_errors(tmp_path / "fitted", ball).mean() < 1.0
    frame = read_dataset(tmp_path / "fitted", ball / "head_model.npz").frames[0]
    assert frame.image.startswith("../own/images/") and frame.mask.startswith("../own/masks/")


def test_cameras_in_another_unit_are_refused(folders, tmp_path, capsys):
    write_colmap(folders, binary=False, unit=0.001)
    assert fit(folders, tmp_path / "fitted") == 1
    found = re.search(
        r"landmarks are (\S+) times as large .* unit of the cameras is about (\S+) of", capsys.readouterr().err
    )
    assert float(found[1]) == pytest.approx(1000, rel=0.1) and float(found[2]) == pytest.approx(0.001, rel=0.1)
    assert fit(folders, tmp_path / "fitted", "--metres-per-unit", "0.001", "--no-refine") == 0


@pytest.mark.usefixtures("stated_order")
def test_bad_calibrations_are_one_line_and_nothing_is_written(folders, ball, tmp_path, capsys):
    assert fit(folders, tmp_path / "fitted") == 1
    error = capsys.readouterr().err
    assert "no calibration; looked for transforms.json, cameras.json, sparse/0" in error and error.count("\n") == 1
    assert fit(ball, tmp_path / "fitted", "--metres-per-unit", "0.001") == 1
    assert "transforms are in metres" in capsys.readouterr().err
    write_cameras(folders)
    assert fit(folders, tmp_path / "fitted", "--metres-per-unit", "0") == 1
    assert "0 metres per unit are impossible" in capsys.readouterr().err
    (folders / "masks/left/0001.png").unlink()
    assert fit(folders, tmp_path / "fitted") == 1
    assert "masks/left/0001.png: no such matte" in capsys.readouterr().err
    assert not (tmp_path / "fitted").exists()


# The convention of cy.

ROWS = 6
"""Rows that are cut off the images at the top."""


def crop(folder: Path, *, flipped: bool) -> None:
    for kind, read in (("images", read_rgb), ("fg_masks", read_grey)):
        for file in (folder / kind).iterdir():
            write_png(file, read(file)[ROWS:])
    with np.load(folder / "landmarks.npz") as content:
        arrays = dict(content)
    arrays["landmarks"][..., 1] -= ROWS
    np.savez(folder / "landmarks.npz", **arrays)
    for file in folder.glob("transforms_*.json"):
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            entry["h"] -= ROWS
            entry["cy"] -= ROWS
            if flipped:
                entry["cy"] = entry["h"] - entry["cy"]
        file.write_text(json.dumps(content))


@pytest.mark.sample(1)
@pytest.mark.usefixtures("stated_order")
@pytest.mark.parametrize("options", [(), ("--cy", "flipped")])
def test_flipped_files_give_the_same_dataset(ball, tmp_path, options, capsys):
    shutil.copytree(ball, tmp_path / "flipped")
    crop(ball, flipped=False)
    crop(tmp_path / "flipped", flipped=True)
    assert fit(ball, tmp_path / "a", "--copy") == 0
    assert "cy is read as opencv: triangulated landmarks are 0.00 pixels off" in capsys.readouterr().out
    assert fit(tmp_path / "flipped", tmp_path / "b", "--copy", *options) == 0
    assert "cy is read as flipped: " in capsys.readouterr().out
    files = [file.relative_to(tmp_path / "a") for file in sorted((tmp_path / "a").rglob("*")) if file.is_file()]
    assert len(files) > 30
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file
    assert vertex_errors(tmp_path / "a", ball).mean() < 1.0


@pytest.mark.usefixtures("stated_order")
def test_nothing_is_said_of_a_centred_principal_point(ball, tmp_path, capsys):
    assert fit(ball, tmp_path / "fitted", "--no-refine") == 0
    assert "cy" not in capsys.readouterr().out


# Files of landmark embeddings.


@pytest.mark.usefixtures("stated_order")
def test_landmarks_of_mediapipe_are_chosen_by_its_embedding(ball, tmp_path):
    """The embedding names some of the landmarks, which lie in triangles; the others are no points of the head."""
    capture, random = read_dataset(ball, ball / "head_model.npz"), np.random.default_rng(0)
    model = capture.model
    faces = np.flatnonzero((model.v_template[model.faces][..., 2] > 0.05).all(axis=1))[::10]
    weights, chosen = random.dirichlet(np.ones(3), len(faces)), random.permutation(100)[: len(faces)]
    values = np.concatenate([random.uniform(0, 40, (4, 3, 100, 2)), np.ones((4, 3, 100, 1))], axis=-1)
    for (t, c), frame in capture.frame_at.items():
        posed = pose(model, capture.parameters(t))
        points = np.einsum("nk,nki->ni", weights, posed[model.faces[faces]])
        values[t, c, chosen, :2] = capture.camera(frame).project(points)[0]
    Landmarks(values, np.arange(4), np.arange(3)).save(ball / "landmarks.npz")
    np.savez(ball / "embedding.npz", lmk_face_idx=faces, lmk_b_coords=weights, landmark_indices=chosen)
    assert fit(ball, tmp_path / "fitted", "--no-refine") == 0
    assert vertex_errors(tmp_path / "fitted", ball).mean() < 0.3
