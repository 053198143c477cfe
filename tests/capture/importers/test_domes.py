"""Captures of Ava-256 and Multiface become datasets that show the same head at the same pixels."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from dome_captures import DomeBust, ply, rigid, write_ava256, write_multiface, write_zip

from carigs.capture import Capture, read_dataset
from carigs.capture.importers.ava256 import CALIBRATED_HEIGHT, CALIBRATED_WIDTH, read_calibration
from carigs.capture.importers.dome import TOLERANCE, spread_cameras
from carigs.capture.importers.mesh_sequence import BATCH, NUM_EXPRESSIONS, track_meshes
from carigs.cli.conversion.captures import main
from carigs.errors import CarigsWarning, InputError, SettingsError
from carigs.head import pose
from carigs.raster import rasterize_mesh

BUST = DomeBust()
WRITERS = {"ava256": write_ava256, "multiface": write_multiface}


@pytest.fixture(scope="module")
def captures(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("domes")
    return {name: write(folder / name, BUST) for name, write in WRITERS.items()}


@pytest.fixture(scope="module")
def converted(captures, tmp_path_factory) -> dict[str, Capture]:
    """Datasets of all frames and cameras."""
    folder, found = tmp_path_factory.mktemp("datasets"), {}
    for name, source in captures.items():
        assert main([str(source), str(folder / name), "--stride", "1", "--copy"]) == 0
        found[name] = read_dataset(folder / name, folder / name / "head_model.npz")
    return found


@pytest.fixture(params=WRITERS)
def name(request) -> str:
    return request.param


@pytest.fixture
def source(captures, name, tmp_path) -> Path:
    """A capture to edit."""
    return next(path for path in shutil.copytree(captures[name].parent, tmp_path / "source").iterdir() if path.is_dir())


def in_dome(frame: int) -> np.ndarray:
    """The vertices of the surface, where the head was in the dome."""
    matrix = BUST.rig_from_head(frame)
    return BUST.local(frame)[np.unique(BUST.bust.faces)] @ matrix[:3, :3].T + matrix[:3, 3]


def test_cameras_see_the_mesh_where_it_was(converted, name):
    capture = converted[name]
    for frame in capture.frames:
        points = pose(capture.model, capture.parameters(frame.timestep))
        ours, depth = capture.camera(frame).project(points)
        theirs, true_depth = BUST.cameras[BUST.names[frame.camera]].project(in_dome(frame.timestep))
        np.testing.assert_allclose(ours, theirs, atol=0.02)  # pixels
        np.testing.assert_allclose(depth, true_depth, atol=1e-4)  # metres: millimetres were converted


@pytest.mark.parametrize("scale", [1, 2, 4])
def test_a_scaled_calibration_puts_points_where_scaled_images_do(captures, scale):
    """The middle of four pixels is the middle of the pixel that is made of them."""
    calibration = read_calibration(captures["ava256"] / "decoder/camera_calibration.json")["400015"]
    camera = calibration.scaled(CALIBRATED_WIDTH // scale, CALIBRATED_HEIGHT // scale, Path("a"))
    points = in_dome(17)
    x, y, _ = (calibration.intrinsics @ camera.to_camera(points).T) / camera.to_camera(points)[:, 2]
    centres = np.stack([x, y], axis=1) + 0.5  # of pixels are whole numbers in the calibration, and halves in a Camera
    np.testing.assert_allclose(camera.project(points)[0], centres / scale, atol=1e-6)


def test_the_world_is_the_head_at_the_neutral_frame(converted, name):
    """y up and the face towards +z, although the dome's frame is turned by more than a right angle."""
    capture = converted[name]
    neutral = [f for f, segment in BUST.frames.items() if segment == "EXP_neutral_peak"]
    still = [f for f in neutral if np.abs(capture.parameters(f).rotation).max() < 1e-9]
    assert len(still) == 1
    expected = BUST.local(still[0])[np.unique(BUST.bust.faces)]
    np.testing.assert_allclose(capture.model.v_template, expected, atol=1e-6)
    np.testing.assert_allclose(pose(capture.model, capture.parameters(still[0])), expected, atol=5e-4)
    mean = np.mean([BUST.local(f) for f in neutral], axis=0)
    assert still[0] == min(neutral, key=lambda f: np.linalg.norm(BUST.local(f) - mean))


def test_faces_are_those_of_the_topology_without_unused_vertices(converted, name):
    model = converted[name].model
    assert len(model.v_template) == len(np.unique(BUST.bust.faces)) < len(BUST.bust.v_template)
    rest = BUST.bust.v_template
    corners = rest[BUST.bust.faces]
    assert model.faces.shape == BUST.bust.faces.shape
    np.testing.assert_allclose(model.v_template[model.faces], corners, atol=2e-3)  # a neutral head moves little


def test_images_and_mattes_show_the_posed_mesh(converted, name):
    capture = converted[name]
    for frame in capture.frames[::5]:
        hit = rasterize_mesh(
            pose(capture.model, capture.parameters(frame.timestep)), capture.model.faces, capture.camera(frame)
        )
        rgb, classes = BUST.picture(frame.timestep, BUST.names[frame.camera])
        assert ((hit.face >= 0) == np.isin(classes, (1, 2))).mean() > 0.995
        if name == "multiface":
            np.testing.assert_array_equal(capture.image8(frame), rgb)
            continue
        stored = cv2.imread(str(capture.root / frame.image), cv2.IMREAD_UNCHANGED)
        assert np.abs(stored[..., 2::-1].astype(int) - rgb).max() <= 6  # of AVIF
        alpha = stored[..., 3]
        assert (alpha[~np.isin(classes, (1, 2))] == 0).all()  # neither what is behind nor the chair
        heights = np.einsum("hwc,hwc->hw", hit.barycentric, capture.model.v_template[capture.model.faces[hit.face], 1])
        above = (hit.face >= 0) & (heights > -0.04) & np.isin(classes, (1, 2))
        assert above.sum() > 100 and (alpha[above] == 255).mean() > 0.98
        labels = cv2.imread(str(capture.root / "labels" / f"{frame.name}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(labels, classes)


def test_mattes_end_at_the_neck(converted, captures, tmp_path):
    """A body below the head, as the labels of Ava-256 have it, is no part of the matte."""
    capture = converted["ava256"]
    source = next(p for p in shutil.copytree(captures["ava256"].parent, tmp_path / "a").iterdir() if p.is_dir())
    for file in (source / "decoder/segmentation_parts").iterdir():
        with zipfile.ZipFile(file) as archive:
            members = {member: archive.read(member) for member in archive.namelist()}
        for member, content in members.items():
            classes = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
            classes[classes.shape[0] * 3 // 4 :] = 2
            members[member] = cv2.imencode(".png", classes)[1].tobytes()
        write_zip(file, members)
    main([str(source), str(tmp_path / "out"), "--stride", "1"])
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    for frame in found.frames[::7]:
        rows = slice(found.camera(frame).height * 7 // 8, None)
        assert found.mask(frame)[rows].max() == 0
        np.testing.assert_allclose(found.mask(frame)[:30], capture.mask(frame)[:30])


def test_segments_become_sequences_and_the_authors_test_segment_is_held_out(converted, name):
    capture = converted[name]
    for frame in capture.frames:
        assert frame.sequence == BUST.frames[frame.timestep]
        assert (frame.split == "test") == (frame.sequence == "EXP_free_face")
    held_out = {frame.camera for frame in capture.split("val")}
    assert [BUST.names[c] for c in held_out] == [BUST.names[1]]  # from the front
    assert {frame.camera for frame in capture.split("train")} == {0, 2, 3}


def test_what_the_download_lacks_is_left_out(converted):
    """An image that was dropped, a frame without a mesh, and a segment in which something covers the head."""
    frames = {(frame.timestep, frame.camera) for frame in converted["ava256"].frames}
    dropped = list(BUST.frames)[4]
    assert (dropped, 0) not in frames and (dropped, 1) in frames
    assert 9000 not in {t for t, _ in frames}
    assert not {t for t, _ in frames} & {f for f, segment in BUST.frames.items() if segment == "EXP_ear"}


def test_fewer_cameras_and_frames(source, tmp_path):
    main([str(source), str(tmp_path / "out"), "--max-cameras", "2", "--stride", "2", "--neutral", "23"])
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    kept = {f for i, f in enumerate(BUST.frames) if i % 3 != 1}
    assert {frame.timestep for frame in found.frames} <= kept and len(found.cameras) == 2
    assert np.abs(found.parameters(23).rotation).max() < 1e-9
    directions = [camera.centre / np.linalg.norm(camera.centre) for camera in found.cameras.values()]
    assert directions[0] @ directions[1] < -0.9 and max(d[2] for d in directions) > 0.9  # the front and the back


def test_undistorted_images_are_those_of_a_pinhole(tmp_path):
    """Without coefficients, nothing moves; with them, edges of the image move as OpenCV says."""
    bust = DomeBust(frames_per_segment=1)
    coefficients = (-8.0, 0.0, 0.0, 0.0)
    for k, values in (("plain", (0.0,) * 4), ("bent", coefficients)):
        source = write_ava256(tmp_path / k, bust, values)
        main([str(source), str(tmp_path / f"{k}_out"), "--stride", "1", "--undistort"])
    plain, bent = (read_dataset(tmp_path / f"{k}_out", tmp_path / f"{k}_out/head_model.npz") for k in ("plain", "bent"))
    frame = plain.frames[0]
    camera = plain.camera(frame)
    image = plain.image8(frame)
    y, x = np.indices(image.shape[:2]) + 0.5
    a, b = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy
    bend = 1 + coefficients[0] * (a**2 + b**2)
    maps = [camera.fx * a * bend + camera.cx - 0.5, camera.fy * b * bend + camera.cy - 0.5]
    stored = cv2.imread(str(plain.root / frame.image), cv2.IMREAD_UNCHANGED)[..., :3]
    expected = cv2.remap(stored, *(m.astype(np.float32) for m in maps), cv2.INTER_LINEAR)
    found = cv2.imread(str(bent.root / frame.image), cv2.IMREAD_UNCHANGED)[..., :3]
    assert np.abs(found.astype(int) - expected).max() <= 2
    assert np.abs(found.astype(int) - stored).max() > 40


def test_one_camera_trains_and_is_not_held_out(captures, tmp_path):
    main([str(captures["ava256"]), str(tmp_path / "out"), "--stride", "1", "--max-cameras", "1"])
    found = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz")
    assert len(found.cameras) == 1 and found.split("train") and found.split("test") and not found.split("val")


@pytest.mark.parametrize("given", [True, False])
def test_long_sequences_have_the_error_that_is_stated(given):
    """More frames than are in memory at once, and than components are kept, of a known rank and noise."""
    rng = np.random.default_rng(3)
    count, rank = 2 * NUM_EXPRESSIONS + 2 * BATCH + 7, 12
    rest, modes = 0.1 * rng.normal(size=(50, 3)), 0.01 * rng.normal(size=(rank, 150))
    still = rest + (rng.normal(size=(count, rank)) @ modes).reshape(count, 50, 3)
    still += 2e-5 * rng.normal(size=still.shape)
    motions = np.stack([rigid(0.3 * rng.normal(size=3), rng.normal(size=3)) for _ in range(count)])
    moved = np.einsum("tij,tvj->tvi", motions[:, :3, :3], still) + motions[:, None, :3, 3]
    faces = np.arange(48).reshape(16, 3)
    points, known = (still, motions) if given else (moved, None)
    track = track_meshes(points, faces, range(count), neutral=5, world_from_head=known, tolerance=TOLERANCE)
    used = track.model.num_expressions
    assert 1 < used <= (rank if given else 100)
    fewer = track_meshes(points, faces, range(count), used - 1, neutral=5, world_from_head=known)
    assert track.mean_residual < TOLERANCE < fewer.mean_residual  # no blendshape more than it takes
    posed = np.stack([pose(track.model, track.parameters[t]) for t in range(count)])
    distances = np.linalg.norm(posed - moved, axis=2)
    assert track.residual == pytest.approx(distances.max(), rel=1e-3)
    assert track.mean_residual == pytest.approx(np.sqrt((distances**2).mean()), rel=1e-3)


def test_cameras_are_spread():
    angles = np.radians([0, 5, 10, 90, 95, 180, -90])
    poses = {}
    for i, angle in enumerate(angles):
        poses[str(i)] = rigid([0, -angle, 0], [0, 0, 1]) @ np.diag([1.0, -1, -1, 1])
    chosen = spread_cameras(poses, 4)
    assert chosen[:2] == ["0", "5"] and {*chosen[2:]} <= {"3", "4", "6"} and "6" in chosen
    assert spread_cameras(poses, 100)[:4] == chosen and len(spread_cameras(poses, 100)) == 7


@pytest.mark.parametrize("vector", [[0, 0, np.pi / 2], [np.pi, 0, 0], [0, np.pi, 0], [-np.pi / 2, 0, 0]])
def test_a_head_frame_with_other_axes_is_turned(captures, converted, tmp_path, vector):
    """On its side, upside down, looking to -z, or with z up: the cameras say where up and the front are."""
    source = next(p for p in shutil.copytree(captures["multiface"].parent, tmp_path / "m").iterdir() if p.is_dir())
    turn = rigid(vector, [0, 0, 0])[:3, :3]
    for f, segment in BUST.frames.items():
        file = source / f"tracked_mesh/{segment}/{f:06d}.bin"
        file.write_bytes((np.fromfile(file, "<f4").reshape(-1, 3) @ turn.T).astype("<f4").tobytes())
        transform = file.with_name(f"{f:06d}_transform.txt")
        rows = np.loadtxt(transform)
        rows[:, :3] = rows[:, :3] @ turn.T
        np.savetxt(transform, rows)
    with pytest.warns(CarigsWarning, match="does not have y up and the face towards"):
        main([str(source), str(tmp_path / "out"), "--stride", "1"])
    found, expected = read_dataset(tmp_path / "out", tmp_path / "out/head_model.npz"), converted["multiface"]
    np.testing.assert_allclose(found.model.v_template, expected.model.v_template, atol=1e-6)
    for ours, theirs in zip(found.cameras.values(), expected.cameras.values(), strict=True):
        np.testing.assert_allclose(ours.camera_from_world, theirs.camera_from_world, atol=1e-6)


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def edit_json(file: Path, **values) -> None:
    content = json.loads(file.read_text())
    content["KRT"][1].update(values)
    file.write_text(json.dumps(content))


def edit_zip(file: Path, **members: bytes | None) -> None:
    """Replace members, named by their number; None removes one."""
    with zipfile.ZipFile(file) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    for number, data in members.items():
        name = next(name for name in content if Path(name).stem == f"{int(number.strip('f')):06d}")
        content[name] = content[name] if data is None else data
        if data is None:
            del content[name]
    write_zip(file, content)


NEUTRAL = "tracked_mesh/EXP_neutral_peak"
MESHES = "decoder/kinematic_tracking/registration_vertices.zip"
POSES = "decoder/head_pose/head_pose.zip"
CALIBRATION = "decoder/camera_calibration.json"
SKEWED = [[1000.0, 0, 0], [7, 1000, 0], [1000, 2000, 1]]
AVA256 = {
    "no topology": (lambda d: (d.parent / "face_topology.obj").unlink(), "no face_topology.obj: the meshes have no f"),
    "no frame list": (lambda d: (d / "decoder/frame_list.csv").unlink(), r"frame_list\.csv: no such list of frames"),
    "another column": (
        lambda d: edit(d / "decoder/frame_list.csv", "frame_id", "frame"),
        r"frame_list\.csv: frame_id: this column is missing",
    ),
    "a frame twice": (
        lambda d: edit(d / "decoder/frame_list.csv", ",20\n", ",17\n"),
        r"frame_list\.csv: frame_id: '17': expected different numbers",
    ),
    "no calibration": (lambda d: (d / CALIBRATION).write_text("{}"), r"calibration\.json: KRT: this key is missing"),
    "a camera without a name": (
        lambda d: edit_json(d / CALIBRATION, cameraId="../up"),
        r"camera_calibration\.json: KRT\[1\]\.cameraId: expected names",
    ),
    "a skew": (lambda d: edit_json(d / CALIBRATION, K=SKEWED), r"KRT\[1\]\.K, T: expected a transposed matrix"),
    "a pose that is not transposed": (
        lambda d: edit_json(d / CALIBRATION, T=[[1, 0, 0, 5.0], [0, 1, 0, 0], [0, 0, 1, 900], [0, 0, 0, 1]]),
        r"KRT\[1\]\.K, T: expected a transposed matrix",
    ),
    "a fisheye": (
        lambda d: edit_json(d / CALIBRATION, distortionModel="Fisheye"),
        r"KRT\[1\]\.distortionModel: only RadialAndTangential",
    ),
    "no images": (lambda d: shutil.rmtree(d / "decoder/image"), r"image: holds no archives camCAMERA\.zip"),
    "an image that is none": (
        lambda d: edit_zip(d / "decoder/image/cam400015.zip", f17=b"no image"),
        r"cam400015\.zip/cam400015/000017\.avif: not a readable AVIF image",
    ),
    "labels that are none": (
        lambda d: edit_zip(d / "decoder/segmentation_parts/cam400015.zip", f17=b"no image"),
        r"cam400015\.zip/cam400015/000017\.png: not a PNG or JPEG image",
    ),
    "a broken archive": (lambda d: (d / MESHES).write_bytes(b"PK\3\4"), r"vertices\.zip: not a readable \.zip"),
    "no head poses": (lambda d: (d / POSES).unlink(), r"head_pose\.zip: no such archive"),
    "a head pose of two rows": (
        lambda d: edit_zip(d / POSES, f20=b"1 0 0 0\n0 1 0 0\n"),
        r"head_pose\.zip: 000020\.txt: expected 3 lines of 4 numbers",
    ),
    "a head pose that scales": (
        lambda d: edit_zip(d / POSES, f20=b"2 0 0 0\n0 2 0 0\n0 0 2 0\n"),
        "head pose of frame 20: .* is no rotation",
    ),
    "a mesh of other vertices": (
        lambda d: edit_zip(d / MESHES, f20=ply(np.ones((1, 3)))),
        r"registration_vertices\.zip/000020\.ply: 1 vertices, face_topology\.obj has 642",
    ),
}  # fmt: skip
MULTIFACE = {
    "a line less": (
        lambda d: edit(d / "KRT", "0.0 0.0 0.0 0.0 0.0\n", ""),
        r"KRT: 31 lines, expected 8 for each camera",
    ),
    "distortion": (
        lambda d: edit(d / "KRT", "0.0 0.0 0.0 0.0 0.0", "0.1 0.0 0.0 0.0 0.0"),
        "KRT: camera 400002: lens distortion is not applied; remedy: undistort",
    ),
    "a word": (lambda d: edit(d / "KRT", "0.0 0.0 0.0 0.0 0.0", "0.0 0.0 zero 0.0 0.0"), "KRT: camera 400002: a word"),
    "a camera twice": (lambda d: edit(d / "KRT", "400015", "400002"), "KRT: camera 400002: two cameras have this name"),
    "no head pose": (
        lambda d: (d / NEUTRAL / "000020_transform.txt").unlink(),
        r"000020_transform\.txt: no such head pose",
    ),
    "a mesh that is cut": (
        lambda d: (d / NEUTRAL / "000020.bin").write_bytes(bytes(24)),
        r"000020\.bin: 24 bytes, expected 7704",
    ),
    "a vertex that is not finite": (
        lambda d: (d / NEUTRAL / "000020.bin").write_bytes(np.full(3 * 642, np.nan, "<f4").tobytes()),
        r"000020\.bin: vertex \d+ is not finite",
    ),
    "no faces": (
        lambda d: (d / "tracked_mesh/EXP_ear/000035.obj").unlink(),
        r"000035\.obj: no such mesh",
    ),
    "no meshes": (lambda d: [f.unlink() for f in (d / "tracked_mesh").rglob("*.bin")], "tracked_mesh: holds no meshes"),
    "an image of another size": (
        lambda d: cv2.imwrite(str(d / "images/EXP_free_face/400015/000044.png"), np.zeros((9, 9, 3), np.uint8)),
        r"400015/000044\.png: 9 x 9 pixels, its camera has",
    ),
    "an image that is a link to nothing": (
        lambda d: [(f := d / "images/EXP_free_face/400015/000044.png").unlink(), f.symlink_to("nowhere")],
        r"400015/000044\.png: no such image",
    ),
    "no images": (lambda d: shutil.rmtree(d / "images"), r"images: holds no folders SEGMENT/CAMERA"),
}  # fmt: skip
CASES = [("ava256", case) for case in AVA256] + [("multiface", case) for case in MULTIFACE]


@pytest.mark.parametrize(("name", "case"), CASES)
def test_what_is_broken_is_named_and_nothing_is_written(source, tmp_path, name, case):
    damage, says = {"ava256": AVA256, "multiface": MULTIFACE}[name][case]
    damage(source)
    with pytest.raises(InputError, match=says) as caught:
        main([str(source), str(tmp_path / "out"), "--stride", "1"])
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_options_of_domes(captures, tmp_path):
    with pytest.raises(SettingsError, match="--stride and --max-cameras are 1 or more"):
        main([str(captures["ava256"]), str(tmp_path / "out"), "--stride", "0"])
    with pytest.raises(SettingsError, match="--topology and --undistort are for Ava-256"):
        main([str(captures["multiface"]), str(tmp_path / "out"), "--undistort"])
    with pytest.raises(InputError, match="there is no frame 18 with a mesh and a head pose"):
        main([str(captures["multiface"]), str(tmp_path / "out"), "--neutral", "18"])
    (tmp_path / "own").mkdir()
    with pytest.raises(InputError, match="--max-cameras is for captures of Ava-256 and Multiface"):
        main([str(tmp_path / "own"), str(tmp_path / "out"), "--max-cameras", "3"])
