"""Downloads from a real server on this machine, which stands for a mirror: slow, broken, stalled, wrong, complete."""

import hashlib
import time

import pytest
from weight_server import serving

from carigs.errors import WeightsMissing
from carigs.readers import download
from carigs.weights.downloads import ATTEMPTS
from carigs.weights.registry import Weights, WeightsFile
from carigs.weights.search import find_weights, mirrored

CONTENT = bytes(range(256)) * 40
SIZE = len(CONTENT)
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(autouse=True)
def places(tmp_path, monkeypatch):
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    for name in ("HF_HUB_CACHE", "CARIGS_WEIGHTS", "http_proxy", "HTTP_PROXY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def server(tmp_path, monkeypatch):
    file = tmp_path / "served/lab.example/net.bin"
    file.parent.mkdir(parents=True)
    file.write_bytes(CONTENT)
    with serving(tmp_path / "served") as server:
        monkeypatch.setenv("CARIGS_WEIGHTS_MIRROR", server.address)
        yield server


def network(sha256=SHA256, size=SIZE, path="net.bin"):
    return Weights("net", "Net", "MIT", (WeightsFile("net.bin", "", f"https://lab.example/{path}", size, sha256),))


def fetch(tmp_path, weights=None):
    return find_weights(weights or network(), tmp_path / "here", download=True)


def test_a_mirror_has_the_files_below_the_names_of_their_hosts(server, tmp_path):
    assert fetch(tmp_path).read_bytes() == CONTENT
    assert server.asked == [("/lab.example/net.bin", None)]
    assert fetch(tmp_path).read_bytes() == CONTENT
    assert len(server.asked) == 1  # it is here


def test_without_a_mirror_addresses_stay_as_they_are(monkeypatch):
    monkeypatch.delenv("CARIGS_WEIGHTS_MIRROR", raising=False)
    assert mirrored("https://lab.example/net.bin") == "https://lab.example/net.bin"
    monkeypatch.setenv("CARIGS_WEIGHTS_MIRROR", "https://mirror.lab/weights/")
    assert mirrored("https://lab.example/net.bin") == "https://mirror.lab/weights/lab.example/net.bin"


def test_a_slow_server_is_waited_for(server, tmp_path):
    server.bytes_per_second = len(CONTENT) / 0.4
    started = time.monotonic()
    assert fetch(tmp_path).read_bytes() == CONTENT
    assert time.monotonic() - started > 0.3


def test_a_connection_that_breaks_is_taken_up_again_where_it_broke(server, tmp_path):
    server.breaks_after = 4000
    assert fetch(tmp_path).read_bytes() == CONTENT
    assert [wanted for _, wanted in server.asked] == [None, "bytes=4000-", "bytes=8000-"]


def test_one_that_breaks_too_often_goes_on_in_the_next_run(server, tmp_path):
    server.breaks_after = 1000
    with pytest.raises(WeightsMissing, match=f"the connection ended after {1000 * ATTEMPTS} of {len(CONTENT)} bytes"):
        fetch(tmp_path)
    assert len(server.asked) == ATTEMPTS
    server.breaks_after = None
    assert fetch(tmp_path).read_bytes() == CONTENT
    assert server.asked[-1] == ("/lab.example/net.bin", f"bytes={1000 * ATTEMPTS}-")


def test_a_server_that_stalls_is_given_up_and_what_came_is_kept(server, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "TIMEOUT_SECONDS", 0.2)
    server.stalls_after = len(CONTENT) // 2
    with pytest.raises(WeightsMissing, match=r"timed out|ended after"):
        fetch(tmp_path)
    server.stalls_after = None
    assert fetch(tmp_path).read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("weights", "says"),
    [
        (network(sha256="0" * 64), "sha256 begins with .*nothing was kept"),
        (network(size=5), f"{len(CONTENT)} bytes, Net has 5"),
        (network(path="other.bin"), "HTTP 404"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(server, tmp_path, weights, says):
    with pytest.raises(WeightsMissing, match=says) as caught:
        fetch(tmp_path, weights)
    assert "\n" not in str(caught.value)
    assert not [path for path in (tmp_path / "here").rglob("*") if path.is_file() and path.suffix != ".lock"]
    assert len(server.asked) == 1  # what is wrong is not asked for again


def test_no_other_host_may_send_without_encryption(tmp_path, monkeypatch):
    for address in (
        "http://lab.example",
        "http://127.0.0.1.lab.example",
        "http://localhost@lab.example",
        "ftp://127.0.0.1",
    ):
        monkeypatch.setenv("CARIGS_WEIGHTS_MIRROR", address)
        with pytest.raises(WeightsMissing, match="only https is downloaded"):
            fetch(tmp_path)
