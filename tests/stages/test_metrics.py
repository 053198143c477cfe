"""Stage `metrics` on the miniature ball: images with known errors, missing truths, bad inputs."""

import numpy as np
import pandas as pd
import pytest
from stages.rendered_ball import edit, index, measured, shown

from carigs.capture import Capture
from carigs.capture.frame_index import read_frame_index
from carigs.capture.images import read_rgb, write_png
from carigs.errors import CarigsWarning, InputError, SettingsError
from carigs.head import pose, read_subject_path
from carigs.raster import rasterize_mesh
from carigs.settings import Metrics
from carigs.stages.metrics import metrics
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.tables.metric_records import REGIONS


def test_a_uniform_error_has_the_same_psnr_in_every_region(scene):
    rows = measured(scene, embeddings=())
    values = [row.value for row in rows if row.metric == "psnr" and pd.notna(row.value)]
    assert len(values) >= 4 * 5  # frames x regions that the ball has
    np.testing.assert_allclose(values, -20 * np.log10(20 / 255), rtol=1e-6)
    assert {row.protocol for row in rows if row.metric == "psnr"} == {"test", "val"}


def test_every_frame_has_a_row_for_every_region_and_metric(scene):
    rows = [row for row in measured(scene, embeddings=()) if row.metric in IMAGE_METRICS]
    keys = [(r.protocol, r.camera, r.timestep, r.region, r.metric) for r in rows]
    assert len(keys) == len(set(keys)) == 4 * len(REGIONS) * len(IMAGE_METRICS)
    for row in rows:
        assert pd.isna(row.value) == bool(row.reason)
    reasons = {row.region: row.reason for row in rows if pd.isna(row.value)}
    assert reasons["mouth"] == "the head model has no region lips" and "eyeball" in reasons["eyes"]


def test_metrics_of_the_geometry_get_the_study_point(scene):
    (row,) = [row for row in measured(scene, embeddings=()) if row.metric == "hole_rate"]
    assert (row.study, row.subject, row.variant, row.gamma, row.level) == ("s", "ball", "v", 0.25, 0.25)
    assert (row.protocol, row.camera, row.timestep, row.region, row.value) == ("test", 0, 3, "full", 0.125)


def test_orbit_frames_that_differ_by_a_constant_flicker_by_it(scene):
    rows = [row for row in measured(scene, embeddings=()) if row.metric == "flicker_l1"]
    values = {(row.camera, row.region): row.value for row in rows}
    assert values == {(i, r): pytest.approx(1 / 3, abs=1e-6) for i in (0, 1) for r in ("full", "face", "skin")}


def paint(scene, protocol, level):
    """Replace the rendered frames of a protocol by images of a ball whose colours are fixed to its surface."""
    subject = Capture.load(scene["capture"])
    caricature = read_subject_path(scene["path"], subject.model).at(level)
    for image in read_frame_index(index(scene)):
        if image.protocol == protocol:
            vertices = pose(subject.model, subject.parameters(image.timestep), caricature)
            camera = image.view or subject.cameras[image.camera]
            hit = rasterize_mesh(vertices, subject.model.faces, camera)
            paints = 0.5 + 3 * subject.model.v_template[subject.model.faces[hit.face]]
            colours = np.einsum("hwc,hwck->hwk", hit.barycentric, paints)
            write_png(image.file, np.where(hit.face[..., None] >= 0, colours, 1.0))


@pytest.mark.parametrize(("protocol", "metric"), [("orbit", "flicker_l1"), ("test", "photo_consistency_l1")])
def test_a_head_with_fixed_colours_neither_flickers_nor_contradicts_itself(scene, protocol, metric):
    def full(rows):
        return [row.value for row in rows if (row.metric, row.region) == (metric, "full")]

    before = full(measured(scene, embeddings=()))
    paint(scene, protocol, 0.25)
    after = full(measured(scene, embeddings=()))
    assert len(after) == len(before) >= 2
    assert max(after) < 0.002 and 20 * max(after) < min(before)
    paint(scene, protocol, 0.0)  # the natural ball, where the mesh is 20 % larger
    assert min(full(measured(scene, embeddings=()))) > max(after)


def test_true_images_have_a_photo_consistency_of_their_own(scene):
    # The renders are the true images plus a constant.
    rows = measured(scene, embeddings=())
    values = {(row.metric, row.camera, row.region): row.value for row in rows if row.metric.startswith("photo_")}
    cameras = {camera for metric, camera, region in values if (metric, region) == ("photo_consistency_l1", "full")}
    assert cameras == {0, 1, 2}
    for camera in cameras:
        true = values["photo_consistency_l1_truth", camera, "full"]
        assert values["photo_consistency_l1", camera, "full"] == pytest.approx(true, abs=1e-6) and true > 0.05


def test_a_constant_does_not_change_the_sharpness_and_half_the_contrast_is_a_quarter(scene):
    def full():
        rows = measured(scene, embeddings=())
        return [row.value for row in rows if (row.metric, row.region) == ("sharpness", "full")]

    np.testing.assert_allclose(full(), [1] * 4, rtol=1e-6)
    subject = Capture.load(scene["capture"])
    for frame in (*subject.split("test"), *subject.split("val")[:1]):
        file = scene["truths"][0].parent / f"frames/{frame.name}.png"
        truth = np.rint(255 * read_rgb(file))
        write_png(file, 2 * (truth // 2) / 255)  # even: halves are exact
        write_png(shown(scene) / f"{frame.name}.png", (truth // 2) / 255)
    np.testing.assert_allclose(full(), 0.25, rtol=1e-6)


def test_without_a_truth_sharpness_is_measured_against_the_frames(scene):
    edit(scene["truths"][0], lambda content: content.update(reason="no true caricature here", frames=[]))
    subject = Capture.load(scene["capture"])
    for frame in subject.split("test"):
        write_png(shown(scene, 0.0) / f"{frame.name}.png", subject.image(frame))
    with pytest.warns(CarigsWarning, match="sharpness, photo_consistency_l1_truth: no true caricature here"):
        rows = measured({**scene, "levels": [0.0]}, embeddings=())
    values = {row.camera: row.value for row in rows
              if (row.protocol, row.metric, row.region) == ("test", "sharpness_to_frame", "full")}  # fmt: skip
    assert values == {camera: 1 for camera in range(3)}


def test_an_error_in_one_region_is_not_seen_in_others(scene):
    before = {(r.region, r.camera): r.value for r in measured(scene, embeddings=()) if r.metric == "psnr"}
    for file in shown(scene).glob("0*.png"):
        image = read_rgb(file)
        image[47:] = 0  # below the ball
        write_png(file, image)
    after = {(r.region, r.camera): r.value for r in measured(scene, embeddings=()) if r.metric == "psnr"}
    changed = {key[0] for key in before if before[key] != after[key]}
    assert "full" in changed and not changed & {"hair", "face", "skin"}


def test_regions_are_those_of_the_caricature_not_of_the_natural_head(scene):
    # At level 0.25 the ball is 20 % larger.  A ring outside the natural ball is head at that level only.
    edit(
        scene["truths"][0],
        lambda c: [c["frames"].__setitem__(i, {**f, "mask": "none.png"}) for i, f in enumerate(c["frames"])],
    )
    write_png(scene["truths"][0].parent / "frames/none.png", np.zeros((48, 40)))
    for file in scene["frames"].glob("*/0*.png"):
        image = read_rgb(file)
        image[24, 20 - 17] = image[24, 20 + 17] = 0  # the natural ball's radius is about 15 pixels, the other's 18
        write_png(file, image)
    exact = -20 * np.log10(20 / 255)
    at = {level: {(r.region, r.camera): r.value for r in measured({**scene, "levels": [level]}, embeddings=())
                  if r.metric == "psnr"} for level in (0.0, 0.25)}  # fmt: skip
    assert at[0.0]["head", 1] == pytest.approx(exact) and at[0.25]["head", 1] < exact - 0.1


def test_without_a_truth_every_metric_is_null_with_its_reason(scene):
    edit(scene["truths"][0], lambda content: content.update(reason="no true caricature here", frames=[]))
    with pytest.warns(CarigsWarning, match="no value of psnr, .*: no true caricature here"):
        rows = [row for row in measured(scene, embeddings=()) if row.metric in IMAGE_METRICS]
    assert {(row.region, row.metric) for row in rows if row.protocol == "test"} == {
        (region, metric) for region in REGIONS for metric in IMAGE_METRICS
    }
    assert {(pd.isna(row.value), row.reason) for row in rows} == {(True, "no true caricature here")}


def test_a_frame_without_a_true_image_is_null_and_the_others_count(scene):
    edit(scene["truths"][0], lambda content: content["frames"].pop(0))
    rows = [row for row in measured(scene, embeddings=()) if (row.region, row.metric) == ("full", "psnr")]
    assert [row.reason for row in rows if pd.isna(row.value)] == ["no true image of this frame"] and len(rows) == 4


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"diffusion": ("sd_3",)}, "sd_3 is unknown"),
        ({"lpips": ("lpips",)}, "lpips is unknown"),
        ({"embeddings": ("vgg",)}, "vgg is unknown"),
        ({"crop": "left"}, "crop=left"),
    ],
)
def test_settings_without_meaning_are_refused_before_any_work(scene, settings, says):
    with pytest.raises(SettingsError, match=says):
        metrics(Metrics(**settings), **{**scene, "capture": scene["records"]})


def test_broken_inputs_are_named_and_leave_nothing_behind(scene):
    def refuses(says):
        with pytest.raises(InputError, match=says):
            metrics(Metrics(lpips=()), **scene)
        assert not scene["records"].exists()

    some = next(shown(scene).glob("0*.png"))
    good = some.read_bytes()
    write_png(some, np.zeros((10, 10, 3)))
    refuses(r"\.png: 10 x 10 pixels, its camera has 40 x 48")
    some.unlink()
    refuses(r"frames\.json: \[\d\]\.file: no such image")
    some.write_bytes(good)
    edit(index(scene), lambda content: content[0].update(timestep=77))
    refuses(r"\.png: the capture has no frame of timestep 77, camera 0")
    edit(index(scene), lambda content: content[-1].update(view={"fx": 1.0}))
    refuses(r"frames\.json: \[6\]\.view\.\w+: this key is missing")
    edit(index(scene), lambda content: content[1].pop("camera"))
    refuses(r"frames\.json: \[1\]\.camera: this key is missing")
    scene["truths"][0].write_text("[]")
    index(scene).write_text("[]")
    refuses(r"truth\.json: expected an object")
