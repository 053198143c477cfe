"""Network weights: where they are searched, what is verified, and what is said when there are none."""

import hashlib
import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
from web import Web

from carigs.errors import InputError, WeightsMissing
from carigs.weights.offline import work_offline
from carigs.weights.registry import Weights, WeightsFile, registry
from carigs.weights.search import find_weights, locate_weights

CONTENT = b"the weights" * 1000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(autouse=True)
def empty_caches(tmp_path, monkeypatch):
    for name in ("HF_HUB_CACHE", "XDG_CACHE_HOME", "CARIGS_WEIGHTS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))


@pytest.fixture
def web(monkeypatch):
    web = Web(CONTENT)
    monkeypatch.setattr(urllib.request, "urlopen", web.open)
    return web


def network(sha256="", size=None, **fields):
    files = (
        WeightsFile("net.pt", "", "https://where/net.pt", size, sha256),
        WeightsFile("net.safetensors", "model.safetensors", "https://huggingface.co/who/net", None, ""),
    )
    return Weights("net", "Net", "MIT", files, **{"hub": "who/net", **fields})


def touch(file, content=CONTENT):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    return file


@pytest.mark.parametrize("name", ["net.pt", "net.safetensors"])
def test_a_file_in_the_folder_is_found(tmp_path, name):
    file = touch(tmp_path / "mine" / name)
    assert find_weights(network(), tmp_path / "mine") == file


def test_places_are_searched_in_their_order(tmp_path, monkeypatch):
    monkeypatch.setenv("CARIGS_WEIGHTS", str(tmp_path / "lab"))
    hubs = ["torch/hub/checkpoints/net.pt", "hf/hub/models--who--net/snapshots/abc/model.safetensors"]
    for name in (*hubs, "lab/net.safetensors", "mine/net.safetensors", "mine/net.pt"):  # the last place first
        file = touch(tmp_path / name)
        assert find_weights(network(), tmp_path / "mine") == file
    assert find_weights(network(), None) == tmp_path / "lab/net.safetensors"


def test_a_network_of_several_files_is_their_folder_once_it_is_complete(tmp_path):
    weights = network(folder="net-v1")
    assert weights.wanted == weights.files
    for place in (tmp_path / "mine/net-v1", tmp_path / "torch/hub/checkpoints/net-v1"):
        touch(place / "net.pt")
        assert locate_weights(weights, tmp_path / "mine") is None
    touch(tmp_path / "torch/hub/checkpoints/net-v1/net.safetensors")
    assert find_weights(weights, tmp_path / "mine") == tmp_path / "torch/hub/checkpoints/net-v1"
    touch(tmp_path / "mine/net-v1/net.safetensors")
    assert find_weights(weights, tmp_path / "mine") == tmp_path / "mine/net-v1"


def test_missing_weights_name_files_folders_and_source(tmp_path, monkeypatch):
    monkeypatch.setenv("CARIGS_WEIGHTS", str(tmp_path / "lab"))
    with pytest.raises(WeightsMissing) as caught:
        find_weights(network(), tmp_path / "mine")
    message = str(caught.value)
    places = [tmp_path / name for name in ("mine", "lab", "hf", "torch")]
    for part in ("net.pt", "net.safetensors", *places, "https://where/net.pt", "MIT", "carigs weights fetch net"):
        assert str(part) in message
    assert "\n" not in message


@pytest.mark.parametrize("known", [SHA256, SHA256[:8], SHA256.upper()])
def test_a_known_checksum_is_verified(tmp_path, known):
    weights = network(sha256=known)
    file = touch(tmp_path / "net.pt")
    assert find_weights(weights, tmp_path) == file
    touch(file, CONTENT[:-1] + b"?")
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 1))
    with pytest.raises(InputError, match=r"net\.pt: sha256 begins with .* damaged .* `carigs weights fetch net`"):
        find_weights(weights, tmp_path)


def test_a_known_size_is_verified_without_reading(tmp_path):
    touch(tmp_path / "net.pt", CONTENT[:-1])
    with pytest.raises(InputError, match=f"{len(CONTENT) - 1} bytes, Net has {len(CONTENT)}: it is incomplete"):
        find_weights(network(size=len(CONTENT)), tmp_path)


def test_nothing_is_asked_over_the_network_without_leave(tmp_path, monkeypatch):
    def connect(*_):
        raise AssertionError("a connection")

    monkeypatch.setattr(socket.socket, "connect", connect)
    monkeypatch.setattr(socket, "getaddrinfo", connect)
    start = time.perf_counter()
    for weights in registry().values():
        with pytest.raises(WeightsMissing):
            find_weights(weights, tmp_path)
    assert time.perf_counter() - start < 1


def test_the_hubs_client_works_offline_once_it_is_imported(monkeypatch):
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    monkeypatch.setitem(os.environ, "HF_HUB_OFFLINE", "")  # restored after the test
    del os.environ["HF_HUB_OFFLINE"]
    work_offline()
    code = "from huggingface_hub import constants; assert constants.HF_HUB_OFFLINE"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", registry())
def test_registered_weights_say_where_they_come_from(name):
    entry = registry()[name]
    assert entry.title and entry.licence and entry.files
    for file in entry.files:
        assert file.url.startswith("https://") or (entry.wheel and file.member)
        assert file.bytes is None or file.bytes > 0
        assert not file.sha256 or 8 <= len(bytes.fromhex(file.sha256)) * 2 <= 64
        assert bool(file.hub) <= bool(entry.hub)


def test_a_download_goes_into_the_users_folder_with_its_checksum(web, tmp_path):
    weights = network(sha256=SHA256, size=len(CONTENT))
    file = find_weights(weights, tmp_path / "mine", download=True)
    assert file == tmp_path / "mine/net.pt" and file.read_bytes() == CONTENT
    assert (tmp_path / "mine/net.pt.sha256").read_text() == f"{SHA256}  net.pt\n"
    assert {path.name for path in file.parent.iterdir()} == {"net.pt", "net.pt.sha256"}
    assert find_weights(weights, tmp_path / "mine", download=True) == file
    assert len(web.asked) == 1


def test_a_download_without_a_folder_goes_where_it_is_found_again(web, tmp_path, monkeypatch):
    assert find_weights(network(), None, download=True) == tmp_path / "torch/hub/checkpoints/net.pt"
    monkeypatch.setenv("CARIGS_WEIGHTS", str(tmp_path / "lab"))
    several = network(folder="net-v1")
    assert find_weights(several, None, download=True) == tmp_path / "lab/net-v1" == find_weights(several, None)


def test_the_checksum_of_a_download_is_verified_where_the_registry_has_none(web, tmp_path):
    file = find_weights(network(), tmp_path, download=True)
    touch(file, CONTENT[::-1])
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 1))
    with pytest.raises(InputError, match="sha256 begins with"):
        find_weights(network(), tmp_path)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"error": urllib.error.URLError("no network")}, "no network"),
        ({"content": CONTENT[::-1]}, "sha256 begins with .*nothing was kept"),
        ({"content": b"<html>"}, "6 bytes, Net has 11000.*nothing was kept"),
    ],
)
def test_a_failed_download_leaves_the_weights_missing(web, tmp_path, changes, says):
    vars(web).update(changes)
    with pytest.raises(WeightsMissing, match=rf"net\.pt.*the download failed: .*{says}"):
        find_weights(network(sha256=SHA256, size=len(CONTENT)), tmp_path, download=True)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_an_interrupted_download_goes_on_when_it_is_started_again(web, tmp_path):
    weights = network(sha256=SHA256)
    web.breaks_after = 500
    with pytest.raises(WeightsMissing, match="ended after 2500"):
        find_weights(weights, tmp_path, download=True)
    with pytest.raises(WeightsMissing):
        find_weights(weights, tmp_path)
    web.breaks_after = None
    assert find_weights(weights, tmp_path, download=True).read_bytes() == CONTENT
    assert [wanted for _, wanted in web.asked] == [None, *(f"bytes={500 * n}-" for n in range(1, 6))]


def test_a_user_without_a_home_folder_is_told_to_name_one(tmp_path, monkeypatch):
    for name in ("HF_HOME", "TORCH_HOME", "HOME"):
        monkeypatch.delenv(name)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # as for a number that is no user
    with pytest.raises(WeightsMissing, match="in any folder"):
        find_weights(network(), None)
    with pytest.raises(WeightsMissing, match="CARIGS_WEIGHTS"):
        find_weights(network(), None, download=True)
    file = touch(tmp_path / "mine" / "net.pt")
    assert find_weights(network(), tmp_path / "mine") == file
