"""Captures whose parts do not belong together: refused where that is certain, named in a warning where it is likely."""

import json
import re
import shutil
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from miniature import write_ball
from planted_mistakes import crop

from carigs.capture import Capture, read_dataset
from carigs.capture.images import read_grey, read_rgb, write_png
from carigs.errors import CarigsWarning, InputError
from carigs.plausibility import check_capture
from carigs.plausibility.views import lies_inside
from carigs.settings import CaptureSettings as Settings
from carigs.stages.capture import capture

FRAMES = 6


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"), timesteps=FRAMES)


@pytest.fixture
def dataset(written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "ball"))


def checked(folder: Path, **options) -> Capture:
    return check_capture(read_dataset(folder, folder / "head_model.npz", **options))


def edit(folder: Path, **values) -> None:
    """Compute fields of every frame from their old values."""
    for split in ("train", "val", "test"):
        file = folder / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            entry.update({key: change(entry[key]) for key, change in values.items()})
        file.write_text(json.dumps(content))


def edit_images(folder: Path, change, pattern: str = "*", kind: str = "images") -> None:
    for file in (folder / kind).glob(f"{pattern}.png"):
        write_png(file, change(read_rgb(file) if kind == "images" else read_grey(file)))


def edit_npz(file: Path, **values) -> None:
    with np.load(file) as content:
        arrays = dict(content)
    np.savez(file, **arrays | {key: change(arrays[key]) for key, change in values.items()})


def swap(folder: Path, a: str, b: str) -> None:
    (folder / a).rename(folder / "between")
    (folder / b).rename(folder / a)
    (folder / "between").rename(folder / b)


def parameters(folder: Path, **values) -> None:
    edit_npz(folder / "flame_param/00002.npz", **values)


def model(folder: Path, **values) -> None:
    edit_npz(folder / "head_model.npz", **values)


def matrix(folder: Path, change) -> None:
    edit(folder, transform_matrix=lambda rows: change(np.array(rows)).tolist())


IMPOSSIBLE = {
    "mirrored cameras": (partial(matrix, change=lambda m: m @ np.diag([-1, 1, 1, 1])), "transform_matrix: .* mirrors"),
    "last row": (partial(matrix, change=lambda m: m + 4 * np.eye(4)[3][:, None] * np.eye(4)[3]), "last row is 0 0 0 5"),
    "negative focal length": (partial(edit, fl_y=lambda f: -f), r"frames\[0\]\.fl_y: a focal length must be positive"),
    "focal length in metres": (partial(edit, fl_x=lambda f: 0.05), "fl_x: .* field of view of 1"),
    "principal point outside": (partial(edit, cx=lambda c: 400), "cx: the principal point 400 lies outside"),
    "normalised principal point": (partial(edit, cx=lambda c: 0.5, cy=lambda c: 0.5), "shares of the image's size"),
    "camera twice": (partial(edit, transform_matrix=lambda m: np.eye(4).tolist()), "cameras 0 and 2 are the same"),
    "half a timestep": (partial(edit, timestep_index=lambda t: t + 0.5), "timestep_index: expected a whole number"),
    "absolute path": (partial(edit, file_path=lambda p: f"/{p}"), "file_path: .* no path inside the dataset"),
    "path elsewhere": (partial(edit, fg_mask_path=lambda p: f"a/../../../{p}"), "fg_mask_path: .* no path inside"),
    "one image for all": (partial(edit, file_path=lambda p: "images/00000_00.png"), "is the image of two frames"),
    "opencv axes": (
        partial(matrix, change=lambda m: m @ np.diag([1, -1, -1, 1])),
        "transform_matrix: the cameras have OpenCV's axes .* remedy: .*negate the second and the third column",
    ),
    "cameras in millimetres": (
        partial(matrix, change=lambda m: np.vstack([m[:3] * [1, 1, 1, 1000], m[3:]])),
        "transform_matrix: the positions of the cameras are in millimetres",
    ),
    "a camera at 1e300": (
        partial(matrix, change=lambda m: m + 1e300 * np.eye(4)[:, :1] * np.eye(4)[3]),
        "transform_matrix: .*the camera is 1e",
    ),
    "a matrix of 1e300": (partial(matrix, change=lambda m: 1e300 * m), "last row"),
    "a rotation of 1e300": (partial(matrix, change=lambda m: np.vstack([1e300 * m[:3], m[3:]])), "is no rotation"),
    "expressions of 1e6": (partial(parameters, expr=lambda x: x + 1e6), "00002.npz: expr: moves vertices by"),
    "a rotation of 45 rad": (partial(parameters, rotation=lambda x: x + 26), "rotation: a rotation of 45.* radians"),
    "degrees": (partial(parameters, jaw_pose=lambda x: x + 15), "jaw_pose: a rotation of 2"),
    "far away": (partial(parameters, translation=lambda x: x + 1e30), "translation: the head is 1e"),
    "outside": (partial(parameters, translation=lambda x: x + 3), "translation: the head is behind .* outside every"),
    "another shape": (partial(parameters, shape=lambda x: x + 1), "shape: differs from .*00000.npz"),
    "another offset": (partial(parameters, static_offset=lambda x: x + 0.01), "static_offset: differs from"),
    "weights of 7": (partial(model, weights=lambda w: 7 * w), r"weights: 7 at \(0, 0\), expected values in"),
    "negative weights": (
        partial(model, weights=lambda w: w - np.eye(5)[1] + np.eye(5)[0]),
        "weights: .*expected values",
    ),
    "a regressor of zeros": (partial(model, J_regressor=lambda r: 0 * r), "J_regressor: .* joint 0 sum to 0"),
    "a model in millimetres": (partial(model, v_template=lambda v: 1e3 * v), "v_template: .* metres"),
    "regions of booleans": (partial(model, mask_scalp=lambda ids: np.arange(642) > 9), "mask_scalp: holds booleans"),
}


@pytest.mark.sample(10)
@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_cannot_be_true_is_refused_in_one_line(dataset, name):
    damage, says = IMPOSSIBLE[name]
    damage(dataset)
    with pytest.raises(InputError, match=says) as caught:
        checked(dataset)
    assert "\n" not in str(caught.value)


def test_a_damaged_image_is_refused_although_its_header_is_sound(dataset):
    file = dataset / "images/00003_01.png"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    read_dataset(dataset, dataset / "head_model.npz")
    with pytest.raises(InputError, match=r"00003_01\.png: not a readable image"):
        checked(dataset)


def two_images(folder: Path) -> None:
    for kind in ("images", "fg_masks"):
        swap(folder, f"{kind}/00000_01.png", f"{kind}/00004_01.png")


UNLIKELY = {
    "inverted mattes": (
        partial(edit_images, change=lambda a: 1 - a, kind="fg_masks"),
        "fg_masks.*shows the background",
    ),
    "empty mattes": (partial(edit_images, change=lambda a: 0 * a, kind="fg_masks"), "matte is empty"),
    "full mattes": (partial(edit_images, change=lambda a: 0 * a + 1, kind="fg_masks"), "is foreground everywhere"),
    "full mattes of a camera": (
        partial(edit_images, change=lambda a: 0 * a + 1, kind="fg_masks", pattern="*_00"),
        "shows the background",
    ),
    "mattes of 0 and 1": (partial(edit_images, change=lambda a: a / 255, kind="fg_masks"), "matte is empty"),
    "shifted mattes": (
        partial(edit_images, change=lambda a: np.roll(a, 6, axis=1), kind="fg_masks"),
        "mesh lies outside the matte",
    ),
    "two swapped mattes": (
        partial(swap, a="fg_masks/00000_01.png", b="fg_masks/00005_01.png"),
        r"fg_masks/0000[05]_01\.png: .*the matte of another timestep fits",
    ),
    "a white image": (partial(edit_images, change=lambda i: 0 * i + 1, pattern="00002_01"), "00002_01.* one colour"),
    "images upside down": (partial(edit_images, change=lambda i: i[::-1], pattern="0000?_01"), "_01.png|camera 1"),
    "a shifted camera": (partial(edit, cx=lambda c: c + 5), "mesh lies outside the matte"),
    "a wide field of view": (partial(edit, fl_x=lambda f: 1.3 * f), "mesh lies outside the matte"),
    "two swapped images": (two_images, r"images/0000[04]_01\.png: the image does not fit its place"),
    "swapped parameters": (
        partial(swap, a="flame_param/00000.npz", b="flame_param/00004.npz"),
        r"flame_param/0000[04]\.npz: most images of the timestep fit another timestep",
    ),
    "swapped cameras": (
        lambda folder: [swap(folder, f"images/{t:05d}_00.png", f"images/{t:05d}_02.png") for t in range(FRAMES)],
        "camera [02]: the camera does not agree",
    ),
    "a copied image": (
        lambda folder: shutil.copyfile(folder / "images/00002_00.png", folder / "images/00002_02.png"),
        r"00002_02\.png: holds the same pixels as images/00002_00\.png",
    ),
    "exchanged channels": (
        partial(edit_images, change=lambda i: i[..., ::-1], pattern="00002_01"),
        r"00002_01\.png: .* red and blue exchanged fits better",
    ),
    "a neck turned by 2 rad": (
        partial(parameters, neck_pose=lambda x: x + 2 * np.eye(3)[1]),
        "neck_pose: turns farther",
    ),
    "faces turned over": (partial(model, f=lambda f: f[:, ::-1]), "f: the faces point inwards"),
}


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", UNLIKELY)
def test_what_is_likely_to_be_wrong_is_named_in_a_warning(dataset, name):
    damage, says = UNLIKELY[name]
    damage(dataset)
    warnings = checked(dataset).warnings
    assert any(re.search(says, line) for line in warnings), warnings
    assert not any("\n" in line for line in warnings)


def composite(folder: Path, background: float, light: float) -> None:
    for file in (folder / "images").iterdir():
        matte = read_grey(folder / "fg_masks" / file.name)[..., None]
        write_png(file, light * (read_rgb(file) - 1 + matte) + background * (1 - matte))


def resize(folder: Path, factor: int) -> None:
    for kind, read in (("images", read_rgb), ("fg_masks", read_grey)):
        for file in (folder / kind).iterdir():
            write_png(file, cv2.resize(read(file), None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC))
    edit(folder, **{key: lambda x: factor * x for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")})


def keep(folder: Path, *cameras: int) -> None:
    for split in ("train", "val", "test"):
        file = folder / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        content["frames"] = [e for e in content["frames"] if e["camera_index"] in cameras][::-1]
        file.write_text(json.dumps(content))


random = np.random.default_rng(0)
SOUND = {
    "as it is": (lambda folder: None, 1.0),
    "black background": (partial(composite, background=0, light=1), 0.0),
    "dark": (partial(composite, background=0.5, light=0.3), 0.5),
    "bright": (partial(composite, background=0, light=1.5), 0.0),
    "noise": (partial(edit_images, change=lambda i: i + 0.03 * random.normal(size=i.shape)), 1.0),
    "one camera": (lambda folder: keep(folder, 0), 1.0),
    "two cameras": (lambda folder: keep(folder, 2, 0), 1.0),
    "higher resolution": (partial(resize, factor=3), 1.0),
    "other numbers": (partial(edit, camera_index=lambda c: 9 - c, timestep_index=lambda t: 100 - 7 * t), 1.0),
}


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", SOUND)
def test_sound_captures_cause_no_warning(dataset, name):
    change, background = SOUND[name]
    change(dataset)
    assert checked(dataset, background=background).warnings == ()


def test_the_background_must_be_the_stated_one(dataset):
    (line,) = checked(dataset, background=0.0).warnings[:1]
    assert "capture.background: outside the matte, the image does not show the stated background" in line
    assert "grey value 1.00, the background is stated as 0" in line


def test_the_stage_warns_and_writes_the_same_lines(dataset, tmp_path):
    edit_images(dataset, lambda a: 0 * a, kind="fg_masks")
    settings = Settings(source="folder", folder=str(dataset), head_model=str(dataset / "head_model.npz"))
    with pytest.warns(CarigsWarning, match=r"matte is empty|one of 3 cameras") as caught:
        capture(settings, index=tmp_path / "capture.json", dataset=tmp_path / "out")
    lines = [str(warning.message) for warning in caught]
    assert json.loads((tmp_path / "capture.json").read_text())["warnings"] == lines
    assert list(Capture.load(tmp_path / "capture.json").warnings) == lines


def test_the_stage_names_a_mistake_that_hides_the_convention_of_cy(dataset, tmp_path):
    crop(dataset)
    matrix(dataset, lambda m: m @ np.diag([1, -1, -1, 1]))
    settings = Settings(source="folder", folder=str(dataset), head_model=str(dataset / "head_model.npz"))
    with pytest.raises(InputError, match="the cameras have OpenCV's axes"):
        capture(settings, index=tmp_path / "capture.json", dataset=tmp_path / "out")


@pytest.mark.parametrize("open_below", [False, True])
def test_points_inside_a_ball_are_inside_also_if_it_is_open_at_the_neck(open_below):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    faces = mesh.faces[mesh.triangles_center[:, 1] > -0.085] if open_below else mesh.faces
    points = np.random.default_rng(0).normal(size=(40, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for point in points:
        assert lies_inside(0.05 * point, mesh.vertices, faces)
        assert lies_inside(0.05 * point, mesh.vertices, faces[:, ::-1])
        assert not lies_inside(0.12 * point, mesh.vertices, faces)
        assert not lies_inside(5 * point, mesh.vertices, faces)


def test_a_camera_inside_the_head_is_named(dataset, centre=(0.02, -0.03, 0.05)):
    def move(entry: dict) -> None:
        for row, value in zip(entry["transform_matrix"], centre, strict=False):
            row[3] = value

    for split in ("train", "test"):
        file = dataset / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            if entry["camera_index"] == 2:
                move(entry)
        file.write_text(json.dumps(content))
    with pytest.raises(
        InputError, match=r"camera 2: transform_matrix: camera 2 lies inside the head mesh of timestep 0"
    ):
        checked(dataset)


def test_mattes_under_another_key_have_the_remedy_that_names_the_key(dataset):
    """The mattes of Nerfstudio."""
    for split in ("train", "val", "test"):
        file = dataset / f"transforms_{split}.json"
        file.write_text(file.read_text().replace("fg_mask_path", "mask_path"))
    lines = checked(dataset).warnings
    assert any("mask_path: is not read as a matte; name mattes by fg_mask_path" in line for line in lines)
    (line,) = (line for line in lines if "frames have no matte" in line)
    assert line.endswith("remedy: export mattes and name them by fg_mask_path")
