"""Finding network weights: folder, hub caches, and what is said when there are none."""

import hashlib
import sys

import pytest

from carigs.errors import InputError, WeightsMissing
from evaluation.metrics.weights import Weights, find_weights, registered


@pytest.fixture(autouse=True)
def empty_caches(tmp_path, monkeypatch):
    for name in ("HF_HUB_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))


@pytest.fixture
def weights():
    return Weights(
        "net", ("net.pt", "net.safetensors"), "who/net", ("model.safetensors",), "https://where/net.pt", "MIT", {}
    )


def touch(file, content=b"weights"):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    return file


@pytest.mark.parametrize("name", ["net.pt", "net.safetensors"])
def test_a_file_in_the_folder_is_found(tmp_path, weights, name):
    file = touch(tmp_path / "mine" / name)
    assert find_weights(weights, tmp_path / "mine") == file


def test_the_caches_of_both_hubs_are_searched_after_the_folder(tmp_path, weights):
    torch_file = touch(tmp_path / "torch/hub/checkpoints/net.pt")
    assert find_weights(weights, None) == torch_file
    hub_file = touch(tmp_path / "hf/hub/models--who--net/snapshots/abc/model.safetensors")
    assert find_weights(weights, None) == hub_file
    assert find_weights(weights, touch(tmp_path / "mine/net.pt").parent) == tmp_path / "mine/net.pt"


def test_missing_weights_name_files_folders_and_source(tmp_path, weights):
    with pytest.raises(WeightsMissing) as caught:
        find_weights(weights, tmp_path / "mine")
    message = str(caught.value)
    for part in (
        "net.pt",
        "net.safetensors",
        tmp_path / "mine",
        tmp_path / "hf",
        tmp_path / "torch",
        weights.source,
        "MIT",
    ):
        assert str(part) in message
    assert "\n" not in message


def test_a_known_checksum_is_verified(tmp_path, weights):
    touch(tmp_path / "net.pt", b"right")
    known = Weights(**{**vars(weights), "sha256": {"net.pt": hashlib.sha256(b"right").hexdigest()[:16]}})
    assert find_weights(known, tmp_path) == tmp_path / "net.pt"
    touch(tmp_path / "net.pt", b"wrong")
    with pytest.raises(InputError, match="sha256 begins with"):
        find_weights(known, tmp_path)


@pytest.mark.parametrize("name", ["clip_vit_b32_openai", "dino_vitb8"])
def test_registered_weights_say_where_they_come_from(name):
    entry = registered(name)
    assert entry.source.startswith("https://") and entry.source.endswith(entry.files[0])
    assert entry.licence and entry.hub and entry.hub_files


def test_a_failed_download_is_missing_weights(tmp_path, weights, monkeypatch):
    import types

    def unreachable(*_):
        raise OSError("no network")

    monkeypatch.setitem(sys.modules, "huggingface_hub", types.SimpleNamespace(hf_hub_download=unreachable))
    with pytest.raises(WeightsMissing, match=r"net\.pt.*download failed"):
        find_weights(weights, tmp_path, download=True)
