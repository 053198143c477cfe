"""Which weights a study needs, what is said without them, and what is made again once they are here."""

import pytest

from carigs.config import compose
from carigs.planning import study_weights
from carigs.planning.study_weights import (
    DIFFUSION,
    DINO,
    EDITORS,
    IDENTITY,
    LPIPS,
    absent_lines,
    empty_records,
    fetch_weights,
    needed_weights,
)
from carigs.settings.edit import EDITORS as CHOICES
from evaluation.metrics import embeddings, identity, lpips, stable_diffusion
from evaluation.metrics.networks import clip


@pytest.fixture(autouse=True)
def places(tmp_path, monkeypatch):
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.delenv("HF_HUB_CACHE", raising=False)
    monkeypatch.setenv("CARIGS_WEIGHTS", str(tmp_path / "weights"))
    monkeypatch.setattr(study_weights, "find_spec", lambda name: None if name == "face_recognition_models" else name)
    return tmp_path / "weights"


def needed(*overrides):
    return {one.weights.name: one for one in needed_weights(overrides)}


def test_weights_are_those_that_the_metrics_ask_for():
    assert study_weights.CLIP[0] == clip.WEIGHTS and IDENTITY[0] == identity.WEIGHTS
    assert {name: weights for name, (weights, _) in DINO.items()} == {
        name: weights for name, (weights, *_) in embeddings.DINO_METRICS.items()
    }
    assert {name: weights for name, (weights, _) in LPIPS.items()} == {
        name: lpips.WEIGHTS[convention.trunk] for name, convention in lpips.LPIPS_METRICS.items()
    }
    assert {name: weights for name, (weights, _) in DIFFUSION.items()} == stable_diffusion.MODELS
    assert {*EDITORS} == {name for name in CHOICES if name != "none" and not name.startswith("drawn_")}


@pytest.mark.slow
def test_a_study_needs_the_weights_of_its_columns_and_variants():
    toy = needed()
    assert [*toy] == ["clip_vit_b32_openai", "dino_vits16", "vgg16_imagenet", "alexnet_imagenet"]
    assert not any(one.variants for one in toy.values())
    paper = needed("study=paper_editing", "metrics.diffusion=[sd_1.5]", "metrics.weights=mine")
    assert paper["instruct_pix2pix"].variants == ("diffusion_edit", "diffusion_edit_nose")
    assert (paper["instruct_pix2pix"].folder, paper["dino_vits16"].folder) == (None, "mine")
    assert paper["stable_diffusion_1.5"].columns == ("SD score",) and "dlib_face_recognition" in paper
    painted = needed("gtstar.provider=exemplar", "gtstar.exemplar=a.png", "study.variants=[alternating,surfhead]")
    assert painted["ip_adapter_sd15"].variants == painted["stable_diffusion_1.5"].variants == ("alternating",)
    # Without true images there is no LPIPS.
    own = ("study=own", "capture.folder=a", "capture.head_model=b.npz")
    assert compose(*own).truth.folder is None and "vgg16_imagenet" not in needed(*own)
    assert needed("metrics.embeddings=[]", "metrics.lpips=[]") == {}


def test_the_identity_network_of_an_installed_package_is_not_needed(monkeypatch):
    monkeypatch.setattr(study_weights, "find_spec", lambda name: name)
    assert "dlib_face_recognition" not in needed("metrics.identity=true")


def test_a_run_says_which_columns_stay_empty_and_which_variants_fail(places):
    overrides = ("study=paper_editing", "metrics.lpips=[]", "metrics.identity=false")
    columns, variants = absent_lines(needed_weights(overrides))
    assert columns == (
        "without weights these columns stay empty: CLIP-I, CLIP-D, CLIP-C (clip_vit_b32_openai, 605 MB), "
        "DINO ViT-S/16 (dino_vits16, 87 MB); --weights downloads them first"
    )
    assert "these variants fail: diffusion_edit, diffusion_edit_nose (instruct_pix2pix, size unknown)" in variants
    places.mkdir()
    (places / "ViT-B-32.pt").write_bytes(b"")
    assert "CLIP" not in absent_lines(needed_weights(overrides))[0]
    assert absent_lines(needed_weights(("metrics.embeddings=[clip]", "metrics.lpips=[]"))) == []


def test_a_package_that_is_missing_is_named_with_what_needs_it(monkeypatch):
    monkeypatch.setattr(study_weights, "find_spec", lambda name: None)
    line = absent_lines(needed_weights(("metrics.embeddings=[]", "metrics.lpips=[]", "metrics.diffusion=[sd_1.5]")))[-1]
    assert line == "diffusers is not installed, which SD score needs: pip install 'carigs[diffusion]'"


def test_what_is_fetched_is_told_with_size_and_licence(monkeypatch, capsys, places):
    fetched = []

    def find(weights, folder, download):
        fetched.append((weights.name, folder, download))

    monkeypatch.setattr(study_weights, "find_weights", find)
    places.mkdir()
    (places / "vit_small_patch16_224.dino.safetensors").write_bytes(b"")
    fetch_weights(needed_weights(("metrics.lpips=[]",)))
    assert fetched == [("clip_vit_b32_openai", None, True), ("dino_vits16", None, True)]
    said = capsys.readouterr().err
    assert said == "carigs: fetching clip_vit_b32_openai: CLIP ViT-B/32 (OpenAI), 605 MB, licence MIT (openai/CLIP)\n"


def test_records_are_made_again_once_the_weights_that_they_lacked_are_here(tmp_path, places):
    record = tmp_path / "results/toy/gamma=0.25/alternating/seed=0/metrics.csv"
    record.parent.mkdir(parents=True)
    record.write_text("clip_d,,no clip_vit_b32_openai weights (ViT-B-32.pt) in any folder\n")
    other = tmp_path / "results/toy/gamma=0.25/surfhead/seed=0/metrics.csv"
    other.parent.mkdir(parents=True)
    other.write_text("dino,,no dino_vits16 weights (dino.pth) in any folder\n")
    assert empty_records(tmp_path / "results", needed_weights(())) == []
    places.mkdir()
    (places / "ViT-B-32.pt").write_bytes(b"")
    assert empty_records(tmp_path / "results", needed_weights(())) == [record]
    assert empty_records(tmp_path / "results", needed_weights(("metrics.embeddings=[dino_vits16]",))) == []
