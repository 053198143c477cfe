"""`carigs weights`: what is listed, verified and downloaded."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest
from web import Web

from carigs.cli.main import main
from carigs.weights.registry import registry


@pytest.fixture(autouse=True)
def places(tmp_path, monkeypatch):
    for name in ("HF_HUB_CACHE", "XDG_CACHE_HOME", "CARIGS_WEIGHTS"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))


@pytest.fixture
def web(monkeypatch):
    web = Web(b"weights")
    monkeypatch.setattr(urllib.request, "urlopen", web.open)
    return web


def test_the_list_says_where_each_is_or_comes_from(tmp_path, capsys):
    file = tmp_path / "dino_vitbase8_pretrain.pth"
    file.write_bytes(bytes(2_000_000))
    assert main(["weights", "list", "--folder", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    for weights in registry().values():
        assert f"{weights.name}: {weights.title}, " in shown and weights.licence in shown
        assert (str(file) if weights.name == "dino_vitb8" else weights.source) in shown
    assert "dino_vitb8: DINO ViT-B/8, 2 MB" in shown


def test_weights_that_are_wrong_are_named_and_fail(tmp_path, capsys):
    (tmp_path / "ViT-B-32.pt").write_bytes(b"half a file")
    (tmp_path / "dino_vitbase8_pretrain.pth").write_bytes(b"not compared")
    assert main(["weights", "verify", "--folder", str(tmp_path)]) == 1
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1 and "ViT-B-32.pt: 11 bytes, CLIP ViT-B/32 (OpenAI) has 353976522" in shown.err
    assert "dino_vits16: missing" in shown.out
    assert "dino_vitbase8_pretrain.pth: there, not compared: no checksum is known" in shown.out
    assert main(["weights", "verify", "dino_vitb8", "--folder", str(tmp_path)]) == 0


def test_a_download_is_verified_by_the_checksum_that_it_keeps(web, tmp_path, capsys):
    assert main(["weights", "fetch", "dino_vitb8", "--folder", str(tmp_path)]) == 0
    file = tmp_path / "vit_base_patch8_224.dino.safetensors"
    assert capsys.readouterr().out.startswith(f"dino_vitb8: {file}, licence Apache-2.0")
    assert main(["weights", "verify", "dino_vitb8", "--folder", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"dino_vitb8: {file}: sha256 of the download agrees\n"
    file.write_bytes(b"WEIGHTS")
    assert main(["weights", "verify", "dino_vitb8", "--folder", str(tmp_path)]) == 1


def test_without_a_network_there_is_one_line(web, tmp_path, capsys):
    web.error = urllib.error.URLError("Name or service not known")
    assert main(["weights", "fetch", "dino_vits16", "--folder", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and error.startswith("carigs: ") and "Name or service not known" in error


def test_unknown_weights_are_a_usage_error(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["weights", "fetch", "vgg"])
    assert ended.value.code == 2
    assert "unknown weights vgg; known: clip_vit_b32_openai, " in capsys.readouterr().err
