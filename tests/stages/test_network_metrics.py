"""Stage `metrics` with networks: scores of tiny ones, missing weights, damaged weights."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from stages.rendered_ball import edit, index, measured, shown

from carigs.capture import Capture
from carigs.capture.images import write_png
from carigs.errors import CarigsWarning, InputError, WeightsMissing

CONSISTENCY = {"clip_c_adjacent", "clip_c_unedited", "clip_c_dir_edit", "clip_c_dir_motion"}
NAMES = {"clip_i_cos", "clip_i_score_w2.5", "clip_i_image", "clip_d", *CONSISTENCY, "dino_vits16_cls"}


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
