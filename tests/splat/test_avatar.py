"""Avatar files and the stages `train` and `render` on the miniature subject."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from miniature import SIZE, write_ball

from carigs.capture import Capture, look_at, read_dataset
from carigs.capture.frame_index import read_frame_index
from carigs.capture.images import read_rgb
from carigs.capture.orbit import nearest_point_to_axes, orbit_cameras
from carigs.errors import InputError, SettingsError
from carigs.exaggeration.gamma_path import straight_path
from carigs.hair import HairShadow
from carigs.hair.hair_shadow import WIDTH
from carigs.head import neutral, read_subject_path
from carigs.light import Shading, fibonacci_sphere
from carigs.plausibility.coverage import capture_coverage
from carigs.runs.contents import content_digest
from carigs.settings import Render, Train
from carigs.splat.avatar import MAX_SEEN, Avatar, load_avatar, save_avatar
from carigs.splat.surfels.ply import read_ply
from carigs.splat.surfels.surfels import to_arrays
from carigs.stages.render import ORBIT_DEGREES, render
from carigs.stages.train import train
from evaluation.metrics.avatar_geometry import AvatarGeometry
from evaluation.tables.frame_records import read_frame_records
from evaluation.tables.metric_records import StudyPoint

INPUTS = {"avatar": "avatar.npz", "capture": "capture.json", "path": "path.npz"}
"""Files of `trained` that the stage `render` reads, by its keywords."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A short training of the ball through the stage."""
    folder = tmp_path_factory.mktemp("trained")
    write_ball(folder / "ball")
    capture = read_dataset(folder / "ball", folder / "ball/head_model.npz")
    capture.save(folder / "capture.json")
    rest = neutral(capture.model, capture.parameters(0))
    straight_path(rest, capture.model.faces, rest * [0.2, 0, 0], 0.25).save(folder / "path.npz")
    train(
        Train(iterations=25, gtstar_probability=0.0, hair_layers=0),
        capture=folder / "capture.json", path=folder / "path.npz", targets=None,
        avatar=folder / "avatar.npz", ply=folder / "avatar.ply", log=folder / "log.csv", resume_key="",
    )  # fmt: skip
    return folder


def test_training_leaves_its_outputs_and_nothing_else(trained):
    assert {p.name for p in trained.iterdir()} == {
        "ball", "capture.json", "path.npz", "avatar.npz", "avatar.ply", "log.csv"
    }  # fmt: skip
    rows = list(csv.DictReader((trained / "log.csv").read_text().splitlines()))
    assert [int(row["iteration"]) for row in rows] == [20, 25]
    assert float(rows[-1]["psnr"]) > 15
    avatar = load_avatar(trained / "avatar.npz")
    for name, value in to_arrays(read_ply(trained / "avatar.ply").surfels).items():
        np.testing.assert_array_equal(value, to_arrays(avatar.surfels)[name])


def test_a_loaded_avatar_renders_the_test_frames(trained):
    """At level 0 the avatar reproduces the test frames."""
    capture = Capture.load(trained / "capture.json")
    avatar = load_avatar(trained / "avatar.npz")
    for frame in capture.split("test"):
        image = avatar.render(frame.timestep, 0.0, capture.cameras[frame.camera])
        error = ((image - capture.image(frame)) ** 2).mean()
        assert -10 * np.log10(error) > 20


def test_changed_expressions_are_kept_and_used(trained, tmp_path):
    """Changes of the expressions by the path are restored from the file and act at levels above 0 only."""
    avatar, jaw = load_avatar(trained / "avatar.npz"), np.array([0])
    sequence, v = avatar.sequence, len(avatar.sequence.head.v_template)
    natural = [sequence.posed(2, level) for level in (0.0, 0.25)]
    lifted = np.tile(np.float32([0, 0.01, 0]), (1, 1, v, 1))
    sequence.path = replace(sequence.path, columns=jaw, changes=lifted)
    save_avatar(tmp_path / "avatar.npz", avatar)
    again = load_avatar(tmp_path / "avatar.npz").sequence
    np.testing.assert_array_equal(again.posed(2, 0.0), natural[0])
    moved = sequence.parameters[2].expression[0] * np.array([0, 0.01, 0])
    assert moved.any()
    shift = again.posed(2, 0.25) - natural[1]  # joints move along: no rotation in it
    np.testing.assert_allclose(shift, np.broadcast_to(moved, shift.shape), atol=1e-6)


def test_an_avatar_says_from_where_it_was_seen_in_plain_words(trained, tmp_path):
    """Viewers show the line: a file from elsewhere puts no markup into it."""
    avatar = load_avatar(trained / "avatar.npz")
    assert avatar.seen == str(capture_coverage(Capture.load(trained / "capture.json")))
    assert avatar.seen.startswith("2 cameras see the head from ")
    avatar.seen = "{alert(1)} <b>all</b>\n[around](http://x.y) " + 1000 * "x"
    save_avatar(tmp_path / "avatar.npz", avatar)
    seen = load_avatar(tmp_path / "avatar.npz").seen
    assert seen.startswith("alert 1 b all b around http: x.y xxx") and len(seen) <= MAX_SEEN
    avatar.seen = ""
    save_avatar(tmp_path / "avatar.npz", avatar)
    assert load_avatar(tmp_path / "avatar.npz").seen == ""


def test_the_level_widens_the_head_as_the_path_says(trained):
    capture = Capture.load(trained / "capture.json")
    avatar = load_avatar(trained / "avatar.npz")

    def width(level):
        covered = (avatar.render(0, level, capture.cameras[1]) < 0.9).any(axis=(0, 2))
        return np.ptp(np.flatnonzero(covered))

    pixel, _ = capture.cameras[1].project(neutral(capture.model, capture.parameters(0)))
    assert width(0.25) - width(0.0) == pytest.approx(0.2 * np.ptp(pixel[:, 0]), abs=2)


def test_colours_follow_the_light_and_the_file_keeps_it(trained, tmp_path):
    """One lamp: triangles that follow get lighter and darker within the limit, and the file alone renders the same."""
    avatar = load_avatar(trained / "avatar.npz")
    plain_image = avatar.render(0, 0.25, Capture.load(trained / "capture.json").cameras[1])
    directions = fibonacci_sphere(64)
    light = np.zeros((len(directions) + 1, 3))
    light[directions[:, 0].argmax()] = 1
    light[-1] = 0.01
    kept = np.zeros(len(avatar.sequence.head.faces), bool)
    kept[::2] = True
    avatar.sequence.shading = Shading(directions, light, 1.0, 2.0, kept)
    shade = avatar.sequence.shade(0, 0.25)
    assert (shade[kept] == 1).all()
    assert 0.72 < shade.min() < 0.95 and 1.05 < shade.max() < 1.38  # 2 to the power 1 / 2.2 is 1.37
    save_avatar(tmp_path / "lit.npz", avatar)
    again = load_avatar(tmp_path / "lit.npz")
    np.testing.assert_array_equal(again.sequence.shade(0, 0.25), shade)
    camera = Capture.load(trained / "capture.json").cameras[1]
    np.testing.assert_array_equal(again.render(0, 0.25, camera), avatar.render(0, 0.25, camera))
    assert np.abs(again.render(0, 0.25, camera) - plain_image).max() > 0.01


def test_skin_brightens_out_of_the_shadow_of_hair(trained, tmp_path):
    """A slab of hair over the ball in light from above: on a caricature that sinks below its edge, and in the file."""
    sequence = load_avatar(trained / "avatar.npz").sequence
    vertices, faces = sequence.rig.vertices, sequence.rig.faces
    light = np.array([[1.0, 1, 1], [0, 0, 0]])
    sequence.shading = Shading(np.array([[0.0, 1, 0]]), light, 1.0, 100.0, np.zeros(len(faces), bool))
    top, middle = vertices.max(axis=0), vertices.mean(axis=0)
    points = np.stack(np.meshgrid(np.arange(-6, 7), [2], np.arange(-6, 7), indexing="ij"), -1).reshape(-1, 3) * WIDTH
    points += np.array([middle[0], top[1], middle[2]])
    carrier = np.flatnonzero(vertices[:, 1] > top[1] - 0.02)[:3].astype(np.int32)

    def lit_by(lit):
        sequence.hair_shadow = HairShadow(
            points.astype(np.float32), np.full(len(points), 0.5, np.float32), np.tile(carrier, (len(points), 1)),
            vertices.astype(np.float32), np.full(len(vertices), lit),
        )  # fmt: skip
        sequence.__dict__.pop("_canonical_transfer", None)
        return sequence.shade_of(vertices)

    above = (vertices[faces] - middle).mean(axis=1)
    below = (np.abs(above[:, [0, 2]]).max(axis=1) < 5 * WIDTH) & (above[:, 1] > 0.5 * (top[1] - middle[1]))
    np.testing.assert_allclose(lit_by(False)[below], 1, atol=1e-5)
    np.testing.assert_allclose(lit_by(True)[below], np.exp(-0.5 / 2.2), rtol=1e-3)  # bare skin moves into the shadow
    shaded = lit_by(False)
    assert len(carrier) == 3 and below.sum() > 20
    away = vertices + np.array([0, 0, 0.3])
    away[carrier] = vertices[carrier]  # the hair stays, the head goes
    bright = sequence.shade_of(away)
    inner = below & ~np.isin(faces, carrier).any(axis=1)
    assert np.median(bright[inner]) == pytest.approx(np.exp(0.5 / 2.2), rel=0.05) and (shaded[inner] < 1.01).all()
    avatar = load_avatar(trained / "avatar.npz")
    avatar.sequence.shading, avatar.sequence.hair_shadow = sequence.shading, sequence.hair_shadow
    save_avatar(tmp_path / "shaded.npz", avatar)
    np.testing.assert_array_equal(load_avatar(tmp_path / "shaded.npz").sequence.shade_of(away), bright)


@pytest.fixture
def files(trained, tmp_path):
    """Keywords of the stage `render`."""
    inputs = {name: trained / file for name, file in INPUTS.items()}
    return {**inputs, "resume_key": "0123", "frames": tmp_path / "frames"}


def test_render_writes_every_protocol_and_its_index(files):
    natural, exaggerated = files["frames"] / "level=0", files["frames"] / "level=0.1"
    render(Render(levels=(0.0, 0.1), orbit_frames=3), **files)
    entries = json.loads((natural / "frames.json").read_text())
    assert [e["protocol"] for e in entries] == ["test"] * 3 + ["val"] * 3 + ["orbit"] * 3
    assert [e["order"] for e in entries] == list(range(9))
    assert entries[0] == {
        "protocol": "test", "timestep": 3, "camera": 0, "sequence": "EXP-2", "file": "test/00003_00.png", "order": 0
    }  # fmt: skip
    for entry in entries:
        assert read_rgb(natural / entry["file"]).shape == (SIZE[1], SIZE[0], 3)
    entries = json.loads((exaggerated / "frames.json").read_text())
    assert [e["protocol"] for e in entries] == ["test"] * 3 + ["orbit"] * 3
    render(Render(levels=(0.1,), orbit_frames=0), **files)
    entries = json.loads((exaggerated / "frames.json").read_text())
    assert [e["protocol"] for e in entries] == ["test"] * 3
    assert not natural.exists() and not (exaggerated / "orbit").exists()


def test_a_killed_rendering_goes_on_with_the_levels_that_are_missing(files, monkeypatch):
    """The same images as of a run that was not killed; with another key, all of them again."""
    settings, killed = Render(levels=(0.0, 0.1, 0.25), orbit_frames=2), {**files, "frames": files["frames"] / "killed"}
    render(settings, **{**files, "frames": files["frames"] / "whole"})
    rendered = []

    def count_frames(self, timestep, level, camera, **keywords):
        if len(rendered) == 10:  # level 0 has 8 frames with those of the held-out camera
            raise KeyboardInterrupt
        rendered.append(level)
        return whole(self, timestep, level, camera, **keywords)

    whole = Avatar.render_frame
    monkeypatch.setattr(Avatar, "render_frame", count_frames)
    with pytest.raises(KeyboardInterrupt):
        render(settings, **killed)
    assert not killed["frames"].exists() and rendered[-2:] == [0.1, 0.1]
    rendered[:] = []
    render(settings, **killed)
    assert rendered == [0.1] * 5 + [0.25] * 5
    assert content_digest(killed["frames"]) == content_digest(files["frames"] / "whole")
    rendered[:] = []
    with pytest.raises(KeyboardInterrupt):
        render(settings, **killed)
    rendered[:] = []
    with pytest.raises(KeyboardInterrupt):
        render(settings, **{**killed, "resume_key": "4567"})
    assert rendered[0] == 0.0


def test_the_cameras_of_the_orbit_are_those_of_its_index(trained, files):
    render(Render(levels=(0.0,), orbit_frames=3), **files)
    rendered = read_frame_index(files["frames"] / "level=0/frames.json")
    expected = orbit_cameras(Capture.load(trained / "capture.json"), 3, ORBIT_DEGREES)
    found = {image.camera: image.view for image in rendered if image.protocol == "orbit"}
    for i, camera in enumerate(expected):
        np.testing.assert_array_equal(found[i].camera_from_world, camera.camera_from_world)
        assert found[i].intrinsics == camera.intrinsics and (found[i].width, found[i].height) == SIZE
    assert all(image.view is None for image in rendered if image.protocol != "orbit")


def test_every_frame_has_its_geometry_and_every_exaggerated_timestep_its_gain(files):
    point = StudyPoint("s", "ball", "v", 0, 0.25, 0.25, "files")
    render(Render(levels=(0.25,), orbit_frames=2), **files)
    records = read_frame_records(files["frames"] / "level=0.25/geometry.csv", point)
    by_metric = {}
    for record in records:
        assert record[: len(point)] == point and record.value is not None
        by_metric.setdefault((record.metric, record.region), []).append(record)
    regions = ("full", "face", "skin")
    for metric in ("depth_error", "normal_error", "silhouette_iou", "hole_rate"):
        for region in regions:
            frames = [(r.protocol, r.timestep, r.camera) for r in by_metric[metric, region]]
            assert frames == [("test", 3, camera) for camera in range(3)]
    for region in regions:  # surfels that move with the mesh
        (gain,) = by_metric["exaggeration_gain", region]
        assert (gain.protocol, gain.timestep, gain.camera) == ("test", 3, None)
        assert gain.value == pytest.approx(1, abs=0.05)
    assert max(r.value for r in by_metric["depth_error", "face"]) < 10
    assert min(r.value for r in by_metric["silhouette_iou", "full"]) > 0.9


def test_an_avatar_that_does_not_follow_its_level_has_no_gain(trained, tmp_path):
    avatar = load_avatar(trained / "avatar.npz")
    capture = Capture.load(trained / "capture.json")
    path = read_subject_path(trained / "path.npz", capture.model)
    meter = AvatarGeometry(capture, avatar, path, 0.25)
    still = avatar.render_frame(3, 0.0, capture.cameras[1]).world
    values = {(r.metric, r.region): r.value for r in meter.records(3, 1, capture.cameras[1], still)}
    assert values["exaggeration_gain", "full"] == pytest.approx(0, abs=1e-6)
    assert values["silhouette_iou", "full"] < 0.9  # the mesh is 20 % wider


def test_levels_beyond_the_path_are_refused(files):
    with pytest.raises(SettingsError, match=r"level 0\.3 lies outside"):
        render(Render(levels=(0.0, 0.3)), **files)
    assert not files["frames"].exists()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"gtstar_probability": 1.5}, "gtstar_probability=1.5 must lie"),
        ({"gtstar_probability": 0.5}, "needs targets"),
        ({"rig": "bones"}, "rig=bones is unknown"),
        ({"sh_degree": 4}, "sh_degree=4 must lie"),
    ],
)
def test_impossible_settings_are_refused_before_any_work(tmp_path, changes, says):
    nothing = tmp_path / "nothing"
    with pytest.raises(SettingsError, match=says):
        settings = Train(**{"gtstar_probability": 0.0, **changes})
        train(
            settings,
            capture=nothing,
            path=nothing,
            targets=None,
            avatar=nothing,
            ply=nothing,
            log=nothing,
            resume_key="",
        )


def test_broken_avatars_are_refused(trained, tmp_path):
    with pytest.raises(InputError, match="no such avatar"):
        load_avatar(tmp_path / "none.npz")
    with pytest.raises(InputError, match=r"path\.npz: format: not a carigs-avatar"):
        load_avatar(trained / "path.npz")
    with np.load(trained / "avatar.npz") as archive:
        arrays = dict(archive)
    arrays["surfel_position"] = arrays["surfel_position"].copy()
    arrays["surfel_position"][5, 1] = np.nan
    np.savez(tmp_path / "nan.npz", **arrays)
    with pytest.raises(InputError, match=r"surfel_position: not a finite number at \(5, 1\)"):
        load_avatar(tmp_path / "nan.npz")
    del arrays["head_weights"]
    np.savez(tmp_path / "short.npz", **{**arrays, "surfel_position": np.nan_to_num(arrays["surfel_position"])})
    with pytest.raises(InputError, match="head_weights: this array is missing"):
        load_avatar(tmp_path / "short.npz")


def test_the_orbit_looks_at_the_cameras_common_point_from_their_distance(trained):
    capture = Capture.load(trained / "capture.json")
    cameras = orbit_cameras(capture, 5, 60.0)
    centres = np.array([c.centre for c in cameras])
    np.testing.assert_allclose(centres[:, 1], 0.05, atol=1e-9)
    radius = np.linalg.norm(centres[:, [0, 2]], axis=1)
    np.testing.assert_allclose(radius, np.hypot(0.4, 1.0), atol=1e-9)  # camera 1 is held out
    azimuth = np.degrees(np.arctan2(centres[:, 0], centres[:, 2]))
    np.testing.assert_allclose(azimuth, [-30, -15, 0, 15, 30], atol=1e-6)
    for camera in cameras:
        pixel, _ = camera.project(np.zeros((1, 3)))
        np.testing.assert_allclose(pixel[0], [camera.cx, camera.cy], atol=1e-6)


def test_the_nearest_point_is_where_the_axes_meet():
    from dataclasses import replace

    target = np.array([0.1, -0.2, 0.3])
    capture_camera = orbit_like(target)
    np.testing.assert_allclose(nearest_point_to_axes(capture_camera), target, atol=1e-9)
    parallel = [replace(capture_camera[0]), replace(capture_camera[0])]
    ahead = parallel[0].centre + parallel[0].camera_from_world[2, :3]
    np.testing.assert_allclose(nearest_point_to_axes(parallel), ahead)


def orbit_like(target):
    from carigs.capture import Camera

    eyes = np.array([[1.0, 0, 1], [-1, 0.5, 1], [0, 2, 2]])
    return [Camera(look_at(eye, target), 50, 50, 5, 5, 10, 10) for eye in eyes]
