"""Stage `metrics` on the miniature ball: images with known errors, missing truths, missing weights, bad inputs."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.capture_json import camera_to_json
from carigs.capture.frame_index import read_frame_index
from carigs.capture.images import read_rgb, write_png
from carigs.capture.orbit import orbit_cameras
from carigs.errors import CarigsWarning, InputError, SettingsError, WeightsMissing
from carigs.exaggeration import straight_path
from carigs.head import neutral, pose, read_subject_path
from carigs.raster import rasterize_mesh
from carigs.settings import Metrics
from carigs.stages.metrics import metrics
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.tables.frame_records import FrameRecord, write_frame_records
from evaluation.tables.metric_records import REGIONS
from evaluation.tables.summary import read_metrics

DIFFERENCE = 20 / 255
CONSISTENCY = {"clip_c_adjacent", "clip_c_unedited", "clip_c_dir_edit", "clip_c_dir_motion"}
NAMES = {"clip_i_cos", "clip_i_score_w2.5", "clip_i_image", "clip_d", *CONSISTENCY, "dino_vits16_cls"}


@pytest.fixture(autouse=True)
def no_weights(tmp_path, monkeypatch):
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    for name in ("HF_HUB_CACHE", "CARIGS_WEIGHTS"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def scene(tmp_path):
    """Keywords of the stage; every rendered pixel is brighter than its truth by DIFFERENCE."""
    read_dataset(write_ball(tmp_path / "ball"), tmp_path / "ball/head_model.npz").save(tmp_path / "capture.json")
    subject = Capture.load(tmp_path / "capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    straight_path(shape, subject.model.faces, 0.2 * shape, 0.25).save(tmp_path / "path.npz")
    frames, truths, random = [], [], np.random.default_rng(0)
    shown = tmp_path / "frames/level=0.25"
    for folder in (shown, tmp_path / "truth/frames"):
        folder.mkdir(parents=True)
    for frame in (*subject.split("test"), *subject.split("val")[:1]):
        image = random.integers(60, 140, (48, 40, 3)) / 255
        write_png(shown / f"{frame.name}.png", image + DIFFERENCE)
        write_png(tmp_path / "truth/frames" / f"{frame.name}.png", image)
        write_png(tmp_path / "truth/frames" / f"{frame.name}_mask.png", subject.mask(frame))
        key = {"timestep": frame.timestep, "camera": frame.camera}
        frames.append(
            {**key, "protocol": frame.split, "sequence": "", "file": f"{frame.name}.png", "order": len(frames)}
        )
        truths.append({**key, "image": f"{frame.name}.png", "mask": f"{frame.name}_mask.png"})
    for i, camera in enumerate(orbit_cameras(subject, 3, 20)):
        write_png(shown / f"orbit{i}.png", np.full((48, 40, 3), i / 3))
        entry = {"timestep": 3, "camera": i, "protocol": "orbit", "file": f"orbit{i}.png", "order": 9 + i}
        frames.append({**entry, "view": camera_to_json(camera)})
    geometry = FrameRecord("test", 0, 3, "full", "hole_rate", 0.125, "")
    write_frame_records(shown / "geometry.csv", [geometry])
    (shown / "frames.json").write_text(json.dumps(frames))
    shutil.copytree(shown, shown.with_name("level=0"))
    (tmp_path / "truth/truth.json").write_text(json.dumps({"level": 0.25, "reason": None, "frames": truths}))
    return {
        "frames": tmp_path / "frames", "capture": tmp_path / "capture.json", "path": tmp_path / "path.npz",
        "truths": [tmp_path / "truth/truth.json"], "records": tmp_path / "rows.csv",
        "embeddings": str(tmp_path / "embeddings"),
        "study": "s", "subject": "ball", "variant": "v", "seed": 0, "gamma": 0.25, "levels": [0.25],
    }  # fmt: skip


def shown(scene, level=0.25):
    """Folder of the rendered frames of a level."""
    return scene["frames"] / f"level={level:g}"


def index(scene):
    return shown(scene) / "frames.json"


def measured(scene, lpips=(), **settings):
    metrics(Metrics(lpips=lpips, **settings), **scene)
    return list(read_metrics([scene["records"]]).itertuples())


def edit(file, change):
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


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


def test_metrics_without_weights_are_null_and_say_where_to_get_them(scene):
    with pytest.warns(CarigsWarning) as warned:
        rows = [row for row in measured(scene) if row.metric in NAMES]
    assert [str(warning.message).split(":")[0] for warning in warned] == [
        "no value of clip_i_cos, clip_i_score_w2.5, clip_i_image, clip_d, clip_c_adjacent, clip_c_unedited, "
        "clip_c_dir_edit, clip_c_dir_motion",
        "no value of dino_vits16_cls",
    ]
    assert {row.metric for row in rows} == NAMES and len(rows) == len(NAMES) + len(CONSISTENCY)
    for row in rows:
        expected = "dino_deitsmall16_pretrain.pth" if row.metric.startswith("dino") else "ViT-B-32.pt"
        assert pd.isna(row.value) and expected in row.reason and "https://" in row.reason
    with pytest.raises(WeightsMissing, match="clip_vit_b32_openai"):
        measured(scene, strict=True)


def test_no_network_library_is_imported_without_weights(scene):
    code = f"""
import sys, json
from pathlib import Path
from carigs.settings import Metrics
from carigs.stages.metrics import metrics
settings = Metrics(lpips=("lpips_vgg",), diffusion=("sd_1.5",), identity=True)
keywords = json.loads({json.dumps(json.dumps(scene, default=str))})
for key, value in keywords.items():
    if key == "truths":
        keywords[key] = [Path(file) for file in value]
    elif isinstance(value, str) and "/" in value:
        keywords[key] = Path(value)
metrics(settings, **keywords)
networks = {{"torch", "torchvision", "torchmetrics", "open_clip", "timm", "diffusers", "transformers", "dlib"}}
assert not (networks | {{"huggingface_hub", "pandas"}}) & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert scene["records"].is_file()


@pytest.fixture
def tiny_networks(tmp_path, monkeypatch):
    """One tiny network stands for CLIP and DINO; it counts the images that it embeds. The folder of its weights."""
    import open_clip
    import torch

    from evaluation.metrics import embeddings
    from evaluation.metrics.networks import embedding_networks

    torch.manual_seed(0)
    tower = {"layers": 1, "width": 32, "head_width": 32, "patch_size": 32, "image_size": 224}
    text = {"context_length": 77, "vocab_size": 49408, "width": 32, "heads": 1, "layers": 1}
    tiny = open_clip.CLIP(embed_dim=16, quick_gelu=True, vision_cfg=tower, text_cfg=text).eval()
    embedded = []

    def patches(network, images):
        vectors = network(images)
        return vectors, vectors.half()

    file = tmp_path / "some.pt"
    file.write_bytes(b"weights")
    monkeypatch.setattr(embeddings, "find_weights", lambda *_, **__: file)
    monkeypatch.setattr(embedding_networks.clip, "load_clip", lambda file: tiny)
    monkeypatch.setattr(embedding_networks.dino, "load_dino", lambda file, model: tiny.encode_image)
    monkeypatch.setattr(embedding_networks.dino, "class_and_patch_tokens", patches)
    tiny.visual.register_forward_hook(lambda module, inputs, output: embedded.append(len(output)))
    return embedded


def test_with_weights_every_frame_has_its_scores(scene, tiny_networks):
    subject = Capture.load(scene["capture"])
    for frame in subject.split("test"):  # a model that does nothing: the renders are the frames themselves
        write_png(shown(scene) / f"{frame.name}.png", subject.image(frame))
    rows = [row for row in measured(scene) if row.metric in NAMES]
    found = {key: [row.value for row in rows if (row.protocol, row.metric) == key]
             for key in {(row.protocol, row.metric) for row in rows}}  # fmt: skip
    assert {key for key in found if key[0] == "orbit"} == {("orbit", name) for name in CONSISTENCY}
    assert {name for protocol, name in found if protocol == "test"} == NAMES
    for name in ("dino_vits16_cls", "clip_i_image"):
        np.testing.assert_allclose(found["test", name], [1, 1, 1])
    assert found["test", "clip_d"] == [0, 0, 0]
    np.testing.assert_allclose(found["test", "clip_i_score_w2.5"], 2.5 * np.maximum(found["test", "clip_i_cos"], 0))
    # The orbit is that of level 0: it is as consistent, moves as it does, and is not edited.
    assert found["orbit", "clip_c_adjacent"] == found["orbit", "clip_c_unedited"]
    np.testing.assert_allclose(found["orbit", "clip_c_dir_motion"], [1, 1])
    assert found["orbit", "clip_c_dir_edit"] == [0, 0]
    assert [row.camera for row in rows if row.metric == "clip_c_adjacent" and row.protocol == "orbit"] == [0, 1]
    # Each camera has one test frame alone.
    alone = [row.reason for row in rows if row.protocol == "test" and row.metric in CONSISTENCY]
    assert alone == ["too few frames were rendered"] * 4


def test_an_image_is_embedded_once_for_all_metrics_levels_and_variants(scene, tiny_networks):
    every = ("clip", "dino_vits16", "dino_vitb8", "dino_vitb8_patch_l11")
    values = [row.value for row in measured(scene, embeddings=every)]
    # Three rendered test frames and their originals; the orbits of both levels are the same three.
    different = {"test": 3 + 3, "orbit": 3}
    assert sum(tiny_networks) == different["test"] + different["orbit"] + 2 * different["test"]
    tiny_networks.clear()
    scene["variant"] = "other"
    np.testing.assert_array_equal([row.value for row in measured(scene, embeddings=every)], values)
    assert tiny_networks == []
    shutil.rmtree(scene["embeddings"])
    np.testing.assert_array_equal([row.value for row in measured(scene, embeddings=every)], values)
    assert sum(tiny_networks) == 21


def test_consistency_of_test_frames_follows_the_timesteps_of_each_camera(scene, tiny_networks):
    subject = Capture.load(scene["capture"])
    frames = [{"timestep": t, "camera": c} for t in sorted({f.timestep for f in subject.frames}) for c in (2, 0)]
    entries = []
    for i, key in enumerate(frames):
        write_png(shown(scene) / f"{i}.png", np.full((48, 40, 3), 0.1 * key["timestep"] + 0.05 * key["camera"]))
        entries.append({**key, "protocol": "test", "file": f"{i}.png", "order": i})
    index(scene).write_text(json.dumps(entries))
    shutil.rmtree(shown(scene, 0.0))
    shutil.copytree(shown(scene), shown(scene, 0.0))
    rows = [row for row in measured(scene, embeddings=("clip",)) if row.metric == "clip_c_adjacent"]
    steps = sorted({entry["timestep"] for entry in entries})
    found = [(row.camera, row.timestep) for row in rows if row.protocol == "test"]
    assert found == [(c, t) for c in (0, 2) for t in steps[:-1]]
    assert [row.reason for row in rows if row.protocol == "orbit"] == ["too few frames were rendered"]


def test_an_orbit_without_level_0_is_refused(scene, tiny_networks):
    (shown(scene, 0.0) / "frames.json").write_text("[]")
    with pytest.raises(InputError, match=r"orbit0\.png: this frame of the orbit was not rendered at level 0"):
        measured(scene)


class _Call:
    def __reduce__(self):
        return open, ("ran", "w")


@pytest.mark.sample(3)
@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("damage", ["truncated", "another network", "a payload", "no weights", "another checksum"])
def test_damaged_weights_are_an_error_in_both_modes(scene, damage, strict, tmp_path, monkeypatch):
    """An empty value would hide that a file which somebody has put there is not used."""
    import timm
    import torch

    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "weights"
    folder.mkdir()
    file = folder / "dino_deitsmall16_pretrain.pth"
    state = timm.create_model("test_vit", num_classes=0).state_dict()
    torch.save({"a": _Call()} if damage == "a payload" else state, file)
    if damage == "truncated":
        file.write_bytes(file.read_bytes()[:-1000])
    elif damage == "no weights":
        file.write_bytes(b"<html>not found</html>")
    elif damage == "another checksum":
        (folder / f"{file.name}.sha256").write_text(f"{'0' * 64}  {file.name}\n")
    with pytest.raises(InputError, match=rf"{file.name}: "):
        measured(scene, weights=str(folder), embeddings=("dino_vits16",), strict=strict)
    assert not (tmp_path / "ran").exists() and not scene["records"].exists()


LPIPS = ("lpips_alex", "lpips_alex_3dgs")


@pytest.mark.slow
def test_lpips_is_measured_over_image_and_head_of_every_frame(scene, tmp_path, monkeypatch):
    import torch
    from torchvision.models import alexnet

    from evaluation.metrics import lpips

    torch.manual_seed(0)
    torch.save(alexnet(weights=None).state_dict(), tmp_path / "random.pth")
    monkeypatch.setattr(lpips, "find_weights", lambda *_, **__: tmp_path / "random.pth")
    rows = [row for row in measured(scene, LPIPS, embeddings=()) if row.metric in LPIPS]
    keys = {(row.protocol, row.camera, row.timestep, row.region, row.metric) for row in rows}
    assert len(keys) == len(rows) == 4 * 2 * 2 and {row.region for row in rows} == {"full", "head"}
    assert all(row.value > 0 for row in rows)


def test_lpips_without_weights_or_truth_is_null_with_its_reason(scene):
    with pytest.warns(CarigsWarning, match="no value of lpips_alex, lpips_alex_3dgs: .*alexnet-owt-7be5be79.pth"):
        rows = [row for row in measured(scene, LPIPS, embeddings=()) if row.metric in LPIPS]
    assert {(row.protocol, row.region) for row in rows} == {(p, r) for p in ("test", "val") for r in ("full", "head")}
    assert all(pd.isna(row.value) and "licence" in row.reason for row in rows) and len(rows) == 8
    with pytest.raises(WeightsMissing, match="alexnet"):
        measured(scene, LPIPS, embeddings=(), strict=True)
    edit(scene["truths"][0], lambda content: content.update(reason="no true caricature here", frames=[]))
    with pytest.warns(CarigsWarning):
        rows = [row for row in measured(scene, LPIPS, embeddings=()) if row.metric in LPIPS]
    assert {row.reason for row in rows} == {"no true caricature here"} and len(rows) == 8


def test_the_sd_score_and_identity_are_null_with_a_reason_where_they_cannot_be_computed(scene):
    with pytest.warns(CarigsWarning) as warned:
        rows = measured(scene, embeddings=(), diffusion=("sd_1.5",), identity=True)
    rows = {row.metric: row for row in rows if row.metric.startswith(("sd", "identity"))}
    assert len(warned) == 2 and all(pd.isna(row.value) for row in rows.values())
    assert "stable-diffusion-v1-5" in rows["sd_1.5"].reason and "Open RAIL-M" in rows["sd_1.5"].reason
    assert rows["identity_cos"].reason == rows["identity_distance"].reason == "the head model has no landmarks"
    with pytest.raises(WeightsMissing, match="no stable_diffusion_1"):
        measured(scene, embeddings=(), diffusion=("sd_1.5",), strict=True)


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
