"""Keys of calibrations: what moves a corner of an image is honoured or refused by its name, never ignored."""

import json
import math
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import NAMES, write_cameras, write_colmap, write_images
from miniature import ball_cameras, write_ball

from carigs.capture import Camera, Capture, read_dataset
from carigs.capture.importers.cameras import read_cameras
from carigs.errors import InputError
from carigs.fitting.footage import read_footage

MOVES = {
    "k1": 0.1, "k2": -0.05, "k4": 1e-3, "k6": 0.2, "p1": 0.01, "p2": -0.01, "s1": 0.02, "k_1": 0.1,
    "distortion_params": [0.1, 0, 0, 0, 0, 0], "distortion": {"k1": 0.1}, "dist_coeffs": [[0.1], [0.0]],
    "dist": [0, 0.1],
    "radial_distortion": [0.1], "tangentialDistortion": [0.0, 0.01], "skew": 3.0, "s": 1.5,
    "camera_model": "OPENCV_FISHEYE", "lens_model": "equirectangular", "is_fisheye": True, "fisheye_crop_radius": 100,
    "distortion_model": "equidistant", "lens_type": "plumb_bob_fisheye", "undistorted": "false",
    "images_undistorted": 0, "k3": "0.1", "p0": 0.001, "distortion_coefficients": "0 0 0.1", "skew_angle": 89.5,
    "dist_model": "kannala_brandt4",
    "distortion_parameters": {"model": "radtan", "k1": 0.1}, "distortion_coeffs": {"model": "equidistant", "k1": 0},
    "equirectangular": True, "rolling_shutter": [0, 0, 0, 0.01], "principal_point": [0.5, 0.5], "is_undistorted": False,
}  # fmt: skip
CHANGES_NOTHING = {
    "k1": 0, "k2": 0.0, "p1": -0.0, "distortion_params": [0.0] * 6, "distortion": {"k1": 0, "k2": 0}, "dist": [],
    "radial_distortion": None, "skew": 0, "camera_model": "OPENCV", "lens_model": "simple-pinhole", "is_fisheye": False,
    "rolling_shutter": [0, 0, 0, 0], "principal_point": None, "is_undistorted": True, "applied_scale": 1.0, "scale": 1,
    "applied_transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "offset": [0, 0, 0],
    "mask_path": None, "aabb_scale": 16,
    "distortion_model": "plumb_bob", "distortion_type": "radtan", "projection_model": "pinhole_camera",
    "lens_type": "inverse_brown_conrady", "camera_type": "pinhole_radial_k3", "undistorted": "true",
    "images_undistorted": 1, "k3": "0.0", "k4": "none", "skew_angle": 90, "shear": math.pi / 2, "s": 0, "p0": 0.0,
    "dist_coeffs": "[0.0, 0.0, 0.0, 0.0, 0.0]", "distortion_parameters": {"model": "radtan", "k1": 0.0},
    "distortion_name": "rational_polynomial", "fisheye": "no",
}  # fmt: skip
MAY_MOVE = {
    "applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]],
    "applied_scale": 0.3,
    "scale": 0.33,
    "offset": [0.5, 0.5, 0.5],
    "K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "crop_x": 12,
    "mask_path": "masks/0.png",
}


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "ball"))


def edit(folder: Path, change, split: str = "train") -> None:
    """Change the content of an index."""
    file = folder / f"transforms_{split}.json"
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def read(folder: Path) -> Capture:
    return read_dataset(folder, folder / "head_model.npz")


@pytest.mark.parametrize("key", MOVES)
def test_what_moves_pixels_is_refused_by_its_name_at_every_door(dataset, tmp_path, key):
    value = {key: MOVES[key]}
    edit(dataset, lambda content: content["frames"][3].update(value))
    with pytest.raises(InputError, match=rf"transforms_train\.json: frames\[3\]\.{key}: .*remedy: ") as caught:
        read(dataset)
    assert str(caught.value).count("\n") == 0
    with pytest.raises(InputError, match=rf"frames\[3\]\.{key}: "):
        read_footage(dataset, dataset / "head_model.npz")
    edit(dataset, lambda content: content["frames"][3].pop(key))
    edit(dataset, lambda content: content.update(value))
    with pytest.raises(InputError, match=rf"transforms_train\.json: {key}: "):
        read(dataset)
    write_cameras(tmp_path)
    content = json.loads((tmp_path / "cameras.json").read_text())
    content["cameras"][1].update(value)
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"cameras\.json: cameras\[1\]\.{key}: "):
        read_cameras(tmp_path / "cameras.json")


@pytest.mark.parametrize("key", CHANGES_NOTHING)
def test_what_changes_nothing_passes_without_a_word(written, dataset, key):
    edit(dataset, lambda content: content.update({key: CHANGES_NOTHING[key]}))
    edit(dataset, lambda content: content["frames"][0].update({key: CHANGES_NOTHING[key]}))
    found = read(dataset)
    assert found.warnings == ()
    for ours, theirs in zip(found.calibrations, read(written).calibrations, strict=True):
        assert ours.intrinsics == theirs.intrinsics
        np.testing.assert_array_equal(ours.camera_from_world, theirs.camera_from_world)


@pytest.mark.parametrize("key", MAY_MOVE)
def test_what_may_move_pixels_is_named_in_one_warning(dataset, key):
    for split in ("train", "test"):
        edit(dataset, lambda content: [entry.update({key: MAY_MOVE[key]}) for entry in content["frames"]], split)
    found = read(dataset)
    assert len(found.warnings) == 2  # of each file
    assert all(f"frames[0].{key}: " in line and key in line for line in found.warnings)


def test_coefficients_that_pass_leave_every_corner_where_opencv_puts_it(dataset):
    """The projection of OpenCV with the coefficients of the file; with others, which are refused, it differs."""
    edit(dataset, lambda content: content.update(camera_model="OPENCV", k1=0, k2=0, p1=0, p2=0))
    camera = read(dataset).calibrations[0]
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
    fx, fy, cx, cy = camera.intrinsics
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    turn, shift = cv2.Rodrigues(camera.camera_from_world[:3, :3])[0], camera.camera_from_world[:3, 3]

    def by_opencv(*coefficients: float) -> np.ndarray:
        return cv2.projectPoints(corners, turn, shift, matrix, np.array(coefficients, np.float64))[0][:, 0]

    np.testing.assert_allclose(camera.project(corners)[0], by_opencv(0, 0, 0, 0), atol=1e-6)
    assert np.abs(by_opencv(0.5, 0, 0, 0) - by_opencv(0, 0, 0, 0)).max() > 0.1


def pinhole(camera: Camera) -> tuple[float, float]:
    """Fields of view in radians."""
    return 2 * math.atan(camera.width / 2 / camera.fx), 2 * math.atan(camera.height / 2 / camera.fy)


def test_both_fields_of_view_place_the_edges_of_the_image(dataset):
    def angles(content):
        for entry in content["frames"]:
            del entry["fl_x"], entry["fl_y"]
        content.update(camera_angle_x=0.5, camera_angle_y=0.7)

    edit(dataset, angles)
    found = read(dataset)
    camera = found.camera(found.split("train")[0])
    assert pinhole(camera) == pytest.approx((0.5, 0.7))
    edge = np.linalg.inv(camera.camera_from_world) @ [0, math.tan(0.35), 1, 1]  # on the lower edge
    np.testing.assert_allclose(camera.project(edge[None, :3])[0], [[camera.cx, camera.height]], atol=1e-9)


def test_a_frame_counts_more_than_its_file(dataset):
    """Also where one states a focal length and the other a field of view."""

    def change(content):
        content.update(fl_x=500.0, fl_y=500.0, camera_angle_x=2 * math.atan(camera.width / 1000))
        for entry in content["frames"]:
            del entry["fl_x"], entry["fl_y"]
            entry.update(camera_angle_x=0.5, camera_angle_y=0.7)

    camera = ball_cameras()[0]
    edit(dataset, change)
    found = read(dataset)
    assert pinhole(found.camera(found.split("train")[0])) == pytest.approx((0.5, 0.7))


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("is_frame", [True, False])
def test_a_focal_length_and_a_field_of_view_that_disagree_are_refused(dataset, axis, is_frame):
    camera = ball_cameras()[0]
    angle = pinhole(camera)[axis == "y"]

    def state(value):
        def change(content):
            for entry in content["frames"][:1] if is_frame else [content]:
                entry.update({f"fl_{axis}": 150.0, f"camera_angle_{axis}": value})
            if not is_frame:
                for entry in content["frames"]:
                    del entry[f"fl_{axis}"]

        return change

    edit(dataset, state(angle * 1.002))
    assert read(dataset).warnings == ()  # a tenth of a pixel
    if is_frame:
        edit(dataset, state(angle * 1.2))
    else:
        edit(dataset, lambda content: content.update({f"camera_angle_{axis}": angle * 1.2}))
    field = rf"frames\[0\]\.camera_angle_{axis}" if is_frame else f"camera_angle_{axis}"
    with pytest.raises(InputError, match=rf"{field}: .* rad is a focal length of 1\d\d\.\d+ pixels, stated are 150"):
        read(dataset)


@pytest.mark.parametrize("coefficients", [(0, 0, 0, 0), (0.1, 0, 0, 0), (0, 0, 0, 1e-3)])
@pytest.mark.parametrize("model", ["OPENCV", "FULL_OPENCV"])
def test_colmaps_models_without_distortion_are_pinholes(written, tmp_path, model, coefficients):
    write_images(tmp_path, read(written))
    write_colmap(tmp_path, False)
    file = tmp_path / "sparse/0/cameras.txt"
    numbers = [*coefficients, *[0] * (4 if model == "FULL_OPENCV" else 0)]
    lines = [
        line.replace("PINHOLE", model) + "".join(f" {k}" for k in numbers) if line[0] != "#" else line
        for line in file.read_text().splitlines()
    ]
    stated = read_cameras(tmp_path / "sparse/0").cameras
    file.write_text("\n".join(lines))
    if any(coefficients):
        with pytest.raises(InputError, match=rf"cameras\.txt: camera 1: {model} with .* is lens distortion"):
            read_cameras(tmp_path / "sparse/0")
    else:
        found = read_cameras(tmp_path / "sparse/0").cameras
        assert {n: c.intrinsics for n, c in found.items()} == {n: c.intrinsics for n, c in stated.items()}


def test_names_that_windows_writes_are_those_of_the_same_images(tmp_path):
    write_colmap(tmp_path / "a", False)
    write_colmap(tmp_path / "b", False, tuple(f"{name}\\0000.png" for name in NAMES))
    assert [*read_cameras(tmp_path / "b/sparse/0").cameras] == [*read_cameras(tmp_path / "a/sparse/0").cameras]
