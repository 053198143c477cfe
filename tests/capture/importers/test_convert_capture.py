"""Captures in other forms become datasets that show the same: cameras and posed meshes to 1e-6, images byte by byte."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import NAMES, write_cameras, write_colmap, write_images
from miniature import ball_cameras, write_ball
from scipy.spatial.transform import Rotation

from carigs.capture import Capture, read_dataset
from carigs.capture.importers.flame_tracks import rotation_vector_of_rows
from carigs.capture.importers.mesh_sequence import track_meshes
from carigs.cli.conversion.captures import main
from carigs.errors import InputError
from carigs.head import pose, pose_frames
from carigs.plausibility import check_capture
from carigs.readers.colmap import read_colmap


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture(scope="module")
def original(ball) -> Capture:
    return read_dataset(ball, ball / "head_model.npz")


@pytest.fixture
def source(original, tmp_path) -> Path:
    """Images and mattes in a folder per camera, cameras.json, and a mesh per frame."""
    folder = tmp_path / "own"
    write_images(folder, original)
    (folder / "meshes").mkdir()
    for t in original.parameter_files:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in pose(original.model, original.parameters(t)).tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (original.model.faces + 1).tolist()]
        (folder / f"meshes/frame_{t}.obj").write_text("\n".join(lines))
    write_cameras(folder)
    return folder


def assert_same(found: Capture, original: Capture) -> None:
    """The same images, cameras, mattes and posed meshes."""
    assert [(f.timestep, f.camera) for f in found.frames] == [(f.timestep, f.camera) for f in original.frames]
    for a, b in zip(found.frames, original.frames, strict=True):
        assert (found.root / a.image).read_bytes() == (original.root / b.image).read_bytes()
        np.testing.assert_array_equal(found.mask(a), original.mask(b))
        ours, theirs = found.camera(a), original.camera(b)
        np.testing.assert_allclose(ours.camera_from_world, theirs.camera_from_world, atol=1e-9)
        np.testing.assert_allclose(ours.intrinsics, theirs.intrinsics, atol=1e-9)
    for t in original.parameter_files:
        posed = pose(found.model, found.parameters(t))
        np.testing.assert_allclose(posed, pose(original.model, original.parameters(t)), atol=1e-6)


@pytest.mark.parametrize("calibration", ["json", "text", "binary"])
def test_meshes_and_cameras(source, original, tmp_path, capsys, calibration):
    if calibration != "json":
        (source / "cameras.json").unlink()
        write_colmap(source, calibration == "binary")
    assert main([str(source), str(tmp_path / "out")]) == 0
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    assert_same(found, original)
    assert {name: len(found.split(name)) for name in ("train", "val", "test")} == {"train": 9, "val": 0, "test": 3}
    assert not any("mesh" in line or "camera" in line for line in check_capture(found).warnings)
    said = capsys.readouterr().out
    assert "4 meshes" in said and "residual" in said and "12 frames" in said


def test_a_dataset_becomes_a_dataset(ball, original, tmp_path):
    assert main([str(ball), str(tmp_path / "out"), "--head-model", str(ball / "head_model.npz"), "--copy"]) == 0
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    assert_same(found, original)
    assert [f.split for f in found.frames] == [f.split for f in original.frames]
    assert not (tmp_path / "out/images/00000_00.png").is_symlink()


@pytest.mark.parametrize("named", [False, True])
def test_parameters_of_vhap(source, ball, original, tmp_path, named, capsys):
    frames = [original.parameters(t) for t in original.parameter_files]
    rows = np.array([frame.joints.reshape(-1) for frame in frames])
    arrays = dict(
        rotation=np.array([f.rotation for f in frames]), translation=np.array([f.translation for f in frames]),
        neck_pose=rows[:, :3], jaw_pose=rows[:, 3:6], eyes_pose=rows[:, 6:],
        shape=frames[0].shape, expr=np.array([f.expression for f in frames]),
    )  # fmt: skip
    if named:
        arrays["timestep_id"] = np.array([f"{t:05d}" for t in original.parameter_files])
    np.savez(source / "tracked_flame_params_30.npz", **arrays)
    for epoch in ("0", "9", "029"):  # of earlier epochs
        np.savez(source / f"tracked_flame_params_{epoch}.npz", **arrays | {"translation": arrays["translation"] + 1})
    assert main([str(source), str(tmp_path / "out"), "--head-model", str(ball / "head_model.npz")]) == 0
    assert "tracked_flame_params_30.npz, the last of 4" in capsys.readouterr().out
    assert_same(read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz"), original)


def test_parameters_per_timestep_and_flat_names(source, ball, original, tmp_path):
    for kind in ("images", "masks"):
        for file in sorted((source / kind).rglob("*.png")):
            file.rename(source / kind / f"{file.stem}_{file.parent.name}.png")
        for name in NAMES:
            (source / kind / name).rmdir()
    (source / "flame_param").mkdir()
    for t, name in original.parameter_files.items():
        (source / f"flame_param/{t}.npz").write_bytes((ball / name).read_bytes())
    assert main([str(source), str(tmp_path / "out"), "--head-model", str(ball / "head_model.npz")]) == 0
    assert_same(read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz"), original)


@pytest.mark.parametrize("seed", range(5))
def test_six_numbers_are_a_rotation(seed):
    rotation = Rotation.random(random_state=seed)
    rows = rotation.as_matrix()[:2] * [[2.0], [0.5]]
    rows[1] += 0.3 * rows[0]
    np.testing.assert_allclose(rotation_vector_of_rows(rows.ravel()), rotation.as_rotvec(), atol=1e-9)


@pytest.mark.parametrize("states_size", [False, True])
def test_a_tracker_that_moves_the_camera(source, ball, original, tmp_path, states_size):
    """The keys of metrical-tracker: the head stands still, a camera per frame; what the image shows is the same."""
    (source / "cameras.json").unlink()
    (source / "flame_param").mkdir()
    for name in ("left", "right"):
        for kind in ("images", "masks"):
            for file in (source / kind / name).iterdir():
                file.unlink()
    jaw = Rotation.from_rotvec([0.2, 0, 0]).as_matrix()[:2].reshape(1, 6)
    for t in original.parameter_files:
        head, camera = original.parameters(t), ball_cameras()[1]
        joint = original.model.joint_regressor[0] @ pose(original.model, replace(head, rotation=np.zeros(3)))
        turn, view = Rotation.from_rotvec(head.rotation).as_matrix(), camera.camera_from_world
        arrays = dict(
            exp=head.expression[None, :50], shape=head.shape[None],
            jaw=jaw, eyes=np.tile([1.0, 0, 0, 0, 1, 0], 2)[None],
            R=(view[:3, :3] @ turn)[None], t=(view[:3, :3] @ (joint - turn @ joint) + view[:3, 3])[None],
            K=np.array([[[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]]),
        )  # fmt: skip
        if states_size:
            arrays["img_size"] = np.array([camera.height, camera.width])
        np.savez(source / f"flame_param/{t:05d}.npz", **arrays)
    assert main([str(source), str(tmp_path / "out"), "--head-model", str(ball / "head_model.npz")]) == 0
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    assert len(found.frames) == len(original.parameter_files)
    for frame in found.frames:
        head = found.parameters(frame.timestep)
        np.testing.assert_allclose(head.joints[1], [0.2, 0, 0], atol=1e-6)
        ours = found.camera(frame).project(pose(found.model, replace(head, joints=np.zeros((4, 3)))))[0]
        theirs = ball_cameras()[1].project(pose(original.model, original.parameters(frame.timestep)))[0]
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_units(source, original, tmp_path):
    """A capture in millimetres becomes one in metres."""
    for file in (source / "meshes").iterdir():
        lines = [line.split() for line in file.read_text().splitlines()]
        scaled = [[w[0], *(repr(1000 * float(x)) for x in w[1:])] if w[0] == "v" else w for w in lines]
        file.write_text("\n".join(" ".join(words) for words in scaled))
    content = json.loads((source / "cameras.json").read_text())
    for entry in content["cameras"]:
        for row in entry["camera_from_world"][:3]:
            row[3] *= 1000
    (source / "cameras.json").write_text(json.dumps(content))
    main([str(source), str(tmp_path / "out"), "--metres-per-unit", "0.001"])
    assert_same(read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz"), original)


def test_jpeg_without_mattes_and_missing_frames(source, tmp_path):
    for file in sorted((source / "images").rglob("*.png")):
        cv2.imwrite(str(file.with_suffix(".jpg")), cv2.imread(str(file)))
        file.unlink()
    (source / "images/left/0001.jpg").unlink()
    for file in sorted((source / "masks").rglob("*.png")):
        file.unlink()
    for name in NAMES:
        (source / "masks" / name).rmdir()
    (source / "masks").rmdir()
    main([str(source), str(tmp_path / "out")])
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    assert len(found.frames) == 11 and all(frame.mask is None for frame in found.frames)
    assert found.foreground(found.frames[0]).mean() > 0.05


@pytest.mark.parametrize("components", [100, 7, 2])
def test_principal_components(components):
    """Exact with as many components as frames; else the residual is at most the singular values that are left out."""
    rng = np.random.default_rng(5)
    shape, frames = rng.normal(size=(60, 3)), 8
    still = shape + 0.05 * rng.normal(size=(frames, 60, 3))
    turned = Rotation.random(frames, random_state=3).as_matrix()
    moved = np.einsum("tij,tvj->tvi", turned, still) + rng.normal(size=(frames, 1, 3))
    track = track_meshes(moved, np.arange(60).reshape(20, 3), list(range(frames)), components)
    posed = pose_frames(track.model, list(track.parameters.values()))
    assert np.linalg.norm(posed - moved, axis=2).max() == pytest.approx(track.residual)
    assert (track.residual < 1e-6) == (components >= frames - 1)
    assert track.model.num_expressions == min(components, frames - 1)


def test_rigid_motion_has_no_expression():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(30, 3))
    turned = np.einsum("tij,vj->tvi", Rotation.random(4, random_state=1).as_matrix(), points)
    track = track_meshes(turned, np.arange(30).reshape(10, 3), [0, 1, 2, 3])
    assert np.abs(track.model.shapedirs).max() < 1e-7 and track.residual < 1e-6


def distort(folder: Path) -> None:
    (folder / "cameras.json").unlink()
    write_colmap(folder, False)
    file = folder / "sparse/0/cameras.txt"
    lines = file.read_text().replace("PINHOLE", "OPENCV").splitlines()
    file.write_text("\n".join(line if line.startswith("#") else f"{line} 0.1 0 0 0" for line in lines))


def cut_binary(folder: Path) -> None:
    (folder / "cameras.json").unlink()
    write_colmap(folder, True)
    file = folder / "sparse/0/images.bin"
    file.write_bytes(file.read_bytes()[:-30])


def edit_camera(folder: Path, **values) -> None:
    content = json.loads((folder / "cameras.json").read_text())
    content["cameras"][1].update(values)
    (folder / "cameras.json").write_text(json.dumps(content))


BROKEN = {
    "distortion": (distort, r"cameras\.txt: camera 1: .*OPENCV with 0.1 0 0 0 is lens distortion"),
    "cut binary model": (cut_binary, r"images\.bin: not a readable file of COLMAP"),
    "no calibration": (lambda d: (d / "cameras.json").unlink(), "no calibration; looked for cameras.json"),
    "unknown camera": (lambda d: edit_camera(d, name="nobody"), r"0000\.png: 0 cameras .* fit camera middle"),
    "scaled pose": (
        lambda d: edit_camera(d, camera_from_world=np.diag([2.0, 2, 2, 1]).tolist()),
        "camera middle: .*rigid",
    ),
    "no focal length": (lambda d: edit_camera(d, fx=0), r"camera middle\.fl_x: a focal length must be positive"),
    "another topology": (
        lambda d: (d / "meshes/frame_2.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3"),
        r"frame_2\.obj: has other faces",
    ),
    "mesh without a number": (
        lambda d: (d / "meshes/frame_2.obj").rename(d / "meshes/frame.obj"),
        r"frame\.obj: the names of meshes end with",
    ),
    "image without a number": (
        lambda d: (d / "images/left/0001.png").rename(d / "images/left/first.png"),
        r"first\.png: images are called CAMERA/TIMESTEP",
    ),
    "a matte is missing": (lambda d: (d / "masks/left/0001.png").unlink(), r"masks/left/0001\.png: no such matte"),
    "an image of another size": (
        lambda d: cv2.imwrite(str(d / "images/left/0001.png"), np.zeros((9, 9, 3), np.uint8)),
        r"0001\.png: 9 x 9 pixels, its camera has 40 x 48",
    ),
    "no heads": (lambda d: (d / "meshes").rename(d / "other"), "no tracked head; looked for"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_named_before_anything_is_written(source, tmp_path, name):
    damage, says = BROKEN[name]
    damage(source)
    with pytest.raises(InputError, match=says) as caught:
        main([str(source), str(tmp_path / "out")])
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("kind", ["cameras", "images"])
def test_a_model_cut_anywhere_is_refused_or_shorter(tmp_path, binary, kind):
    write_colmap(tmp_path, binary)
    file = tmp_path / f"sparse/0/{kind}.{'bin' if binary else 'txt'}"
    whole, content = read_colmap(tmp_path / "sparse/0"), file.read_bytes()
    for length in range(0, len(content), 3):
        file.write_bytes(content[:length])
        try:
            found = read_colmap(tmp_path / "sparse/0")
        except InputError:
            continue
        assert not binary and len(found) <= len(whole)


def test_nothing_is_overwritten(source, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/precious").write_text("data")
    with pytest.raises(InputError, match="out: is not empty"):
        main([str(source), str(tmp_path / "out")])
