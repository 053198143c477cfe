"""Stage `metrics` on the miniature ball: images with known errors, missing truths, missing weights, bad inputs."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.images import read_rgb, write_png
from carigs.errors import CarigsWarning, InputError, SettingsError, WeightsMissing
from carigs.exaggeration import straight_path
from carigs.head import neutral
from carigs.settings import Metrics
from carigs.stages.metrics import metrics
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.tables.metric_records import REGIONS
from evaluation.tables.summary import read_metrics

GREY, DIFFERENCE = 100 / 255, 20 / 255
NAMES = {"clip_i_cos", "clip_i_score_w2.5", "clip_d", "clip_c_adjacent", "dino_vitb8_cls"}


@pytest.fixture(autouse=True)
def no_weights(tmp_path, monkeypatch):
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.delenv("HF_HUB_CACHE", raising=False)


@pytest.fixture
def scene(tmp_path):
    """Keywords of the stage; every rendered pixel is brighter than its truth by DIFFERENCE."""
    read_dataset(write_ball(tmp_path / "ball"), tmp_path / "ball/head_model.npz").save(tmp_path / "capture.json")
    subject = Capture.load(tmp_path / "capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    straight_path(shape, subject.model.faces, 0.2 * shape, 0.25).save(tmp_path / "path.npz")
    frames, truths = [], []
    for name in ("frames", "truth/frames"):
        (tmp_path / name).mkdir(parents=True)
    for frame in (*subject.split("test"), *subject.split("val")[:1]):
        image = np.full((48, 40, 3), GREY)
        write_png(tmp_path / "frames" / f"{frame.name}.png", image + DIFFERENCE)
        write_png(tmp_path / "truth/frames" / f"{frame.name}.png", image)
        write_png(tmp_path / "truth/frames" / f"{frame.name}_mask.png", subject.mask(frame))
        key = {"timestep": frame.timestep, "camera": frame.camera}
        frames.append(
            {**key, "protocol": frame.split, "sequence": "", "file": f"{frame.name}.png", "order": len(frames)}
        )
        truths.append({**key, "image": f"{frame.name}.png", "mask": f"{frame.name}_mask.png"})
    for i in range(3):
        write_png(tmp_path / "frames" / f"orbit{i}.png", np.full((48, 40, 3), i / 3))
        frames.append({"timestep": 3, "camera": i, "protocol": "orbit", "file": f"orbit{i}.png", "order": 9 + i})
    (tmp_path / "frames.json").write_text(json.dumps(frames))
    (tmp_path / "truth/truth.json").write_text(json.dumps({"level": 0.25, "reason": None, "frames": truths}))
    return {
        "frames": tmp_path / "frames", "index": tmp_path / "frames.json", "capture": tmp_path / "capture.json",
        "path": tmp_path / "path.npz", "truth": tmp_path / "truth/truth.json", "records": tmp_path / "rows.csv",
        "study": "s", "subject": "ball", "variant": "v", "gamma": 0.25, "level": 0.25,
    }  # fmt: skip


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
    assert {row.protocol for row in rows} == {"test", "val"}


def test_every_frame_has_a_row_for_every_region_and_metric(scene):
    rows = measured(scene, embeddings=())
    keys = [(r.protocol, r.camera, r.timestep, r.region, r.metric) for r in rows]
    assert len(keys) == len(set(keys)) == 4 * len(REGIONS) * len(IMAGE_METRICS)
    for row in rows:
        assert pd.isna(row.value) == bool(row.reason)
    reasons = {row.region: row.reason for row in rows if pd.isna(row.value)}
    assert reasons["mouth"] == "the head model has no region lips" and "eyeball" in reasons["eyes"]


def test_an_error_in_one_region_is_not_seen_in_others(scene):
    before = {(r.region, r.camera): r.value for r in measured(scene, embeddings=()) if r.metric == "psnr"}
    for file in scene["frames"].glob("0*.png"):
        image = read_rgb(file)
        image[47:] = 0  # below the ball
        write_png(file, image)
    after = {(r.region, r.camera): r.value for r in measured(scene, embeddings=()) if r.metric == "psnr"}
    changed = {key[0] for key in before if before[key] != after[key]}
    assert "full" in changed and not changed & {"hair", "face", "skin"}


def test_regions_are_those_of_the_caricature_not_of_the_natural_head(scene):
    # At level 0.25 the ball is 20 % larger.  A ring outside the natural ball is head at that level only.
    edit(
        scene["truth"],
        lambda c: [c["frames"].__setitem__(i, {**f, "mask": "none.png"}) for i, f in enumerate(c["frames"])],
    )
    write_png(scene["truth"].parent / "frames/none.png", np.zeros((48, 40)))
    for file in scene["frames"].glob("0*.png"):
        image = read_rgb(file)
        image[24, 20 - 17] = image[24, 20 + 17] = 0  # the natural ball's radius is about 15 pixels, the other's 18
        write_png(file, image)
    exact = -20 * np.log10(20 / 255)
    at = {level: {(r.region, r.camera): r.value for r in measured({**scene, "level": level}, embeddings=())
                  if r.metric == "psnr"} for level in (0.0, 0.25)}  # fmt: skip
    assert at[0.0]["head", 1] == pytest.approx(exact) and at[0.25]["head", 1] < exact - 0.1


def test_without_a_truth_every_metric_is_null_with_its_reason(scene):
    edit(scene["truth"], lambda content: content.update(reason="no true caricature here", frames=[]))
    with pytest.warns(CarigsWarning, match="no value of psnr, .*: no true caricature here"):
        rows = [row for row in measured(scene, embeddings=()) if row.metric in IMAGE_METRICS]
    assert {(row.region, row.metric) for row in rows if row.protocol == "test"} == {
        (region, metric) for region in REGIONS for metric in IMAGE_METRICS
    }
    assert {(pd.isna(row.value), row.reason) for row in rows} == {(True, "no true caricature here")}


def test_a_frame_without_a_true_image_is_null_and_the_others_count(scene):
    edit(scene["truth"], lambda content: content["frames"].pop(0))
    rows = [row for row in measured(scene, embeddings=()) if (row.region, row.metric) == ("full", "psnr")]
    assert [row.reason for row in rows if pd.isna(row.value)] == ["no true image of this frame"] and len(rows) == 4


def test_metrics_without_weights_are_null_and_say_where_to_get_them(scene):
    with pytest.warns(CarigsWarning) as warned:
        rows = [row for row in measured(scene) if row.metric in NAMES]
    assert [str(warning.message).split(":")[0] for warning in warned] == [
        "no value of clip_i_cos, clip_i_score_w2.5, clip_d, clip_c_adjacent",
        "no value of dino_vitb8_cls",
    ]
    assert {row.metric for row in rows} == NAMES and len(rows) == len(NAMES)
    for row in rows:
        expected = "dino_vitbase8_pretrain.pth" if row.metric.startswith("dino") else "ViT-B-32.pt"
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
metrics(settings, **{{key: Path(value) if isinstance(value, str) and "/" in value else value
                      for key, value in json.loads({json.dumps(json.dumps(scene, default=str))}).items()}})
networks = {{"torch", "torchvision", "torchmetrics", "open_clip", "timm", "diffusers", "transformers", "dlib"}}
assert not (networks | {{"huggingface_hub", "pandas"}}) & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert scene["records"].is_file()


def test_with_weights_every_frame_has_its_scores(scene, monkeypatch):
    import open_clip
    import torch

    from evaluation.metrics import embeddings

    torch.manual_seed(0)
    tower = {"layers": 1, "width": 32, "head_width": 32, "patch_size": 32, "image_size": 224}
    text = {"context_length": 77, "vocab_size": 49408, "width": 32, "heads": 1, "layers": 1}
    tiny = open_clip.CLIP(embed_dim=16, quick_gelu=True, vision_cfg=tower, text_cfg=text).eval()
    monkeypatch.setattr(embeddings, "find_weights", lambda *_, **__: Path("some.pt"))
    monkeypatch.setattr(embeddings.clip, "load_clip", lambda file: tiny)
    monkeypatch.setattr(embeddings.dino, "load_dino", lambda file: tiny.encode_image)
    subject = Capture.load(scene["capture"])
    for frame in subject.split("test"):  # a model that does nothing: the renders are the frames themselves
        write_png(scene["frames"] / f"{frame.name}.png", subject.image(frame))
    rows = [row for row in measured(scene) if row.metric in NAMES]
    by_name = {name: [row for row in rows if row.metric == name] for name in NAMES}
    assert {name: len(rows) for name, rows in by_name.items()} == {name: 2 if "_c_" in name else 3 for name in NAMES}
    assert {(row.protocol, row.camera) for row in by_name["clip_c_adjacent"]} == {("orbit", 0), ("orbit", 1)}
    assert [row.value for row in by_name["clip_d"]] == [0, 0, 0]
    np.testing.assert_allclose([row.value for row in by_name["dino_vitb8_cls"]], 1)


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
    edit(scene["truth"], lambda content: content.update(reason="no true caricature here", frames=[]))
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
    with pytest.raises(WeightsMissing, match="stable_diffusion_1.5"):
        measured(scene, embeddings=(), diffusion=("sd_1.5",), strict=True)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"diffusion": ("sd_3",)}, "sd_3 is unknown"),
        ({"lpips": ("lpips",)}, "lpips is unknown"),
        ({"embeddings": ("vgg",)}, "vgg is unknown"),
        ({"crop": "left"}, "crop=left"),
        ({"silhouette_band": 0}, "silhouette_band=0 must lie"),
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

    some = next(scene["frames"].glob("0*.png"))
    good = some.read_bytes()
    write_png(some, np.zeros((10, 10, 3)))
    refuses(r"\.png: 10 x 10 pixels, its camera has 40 x 48")
    some.unlink()
    refuses(r"frames\.json: \[\d\]\.file: no such image")
    some.write_bytes(good)
    edit(scene["index"], lambda content: content[1].pop("camera"))
    refuses(r"frames\.json: \[1\]\.camera: this key is missing")
    scene["truth"].write_text("[]")
    scene["index"].write_text("[]")
    refuses(r"truth\.json: frames: this key is missing")
