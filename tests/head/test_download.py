"""Downloads: what is not expected is refused, and nothing is replaced then."""

from __future__ import annotations

import hashlib
import urllib.error
import urllib.request

import pytest
from heads import gnm_file, gnm_like
from web import Web

from carigs.cli.main import main
from carigs.errors import InputError
from carigs.head import HeadModel, download
from carigs.head.download import GNM_URL, fetch_head


@pytest.fixture
def server(monkeypatch, tmp_path):
    web = Web(gnm_file(tmp_path, gnm_like(0)).read_bytes())
    monkeypatch.setattr(urllib.request, "urlopen", web.open)
    return web


def test_a_model_is_downloaded_with_its_checksum(server, tmp_path, capsys):
    file = tmp_path / "models" / "gnm.npz"
    assert main(["head", "fetch", "gnm", "-o", str(file)]) == 0
    digest = hashlib.sha256(server.content).hexdigest()
    assert capsys.readouterr().out == f"{file}  sha256 {digest}\n"
    assert file.with_name("gnm.npz.sha256").read_text() == f"{digest}  gnm.npz\n"
    assert len(HeadModel.load(file).parents) == 4
    assert fetch_head(GNM_URL, file) == digest  # again


def test_a_changed_file_is_refused(server, tmp_path):
    file = tmp_path / "gnm.npz"
    fetch_head(GNM_URL, file)
    before = file.read_bytes()
    other = tmp_path / "other"
    other.mkdir()
    server.content = gnm_file(other, gnm_like(1)).read_bytes()
    with pytest.raises(InputError, match=r"has the sha256 .* as before; remove .*gnm\.npz\.sha256"):
        fetch_head(GNM_URL, file)
    assert file.read_bytes() == before
    file.with_name("gnm.npz.sha256").unlink()
    assert fetch_head(GNM_URL, file) == hashlib.sha256(server.content).hexdigest()


REFUSED = {
    "no network": ({"error": urllib.error.URLError("Name or service not known")}, "cannot be downloaded .Name or ser"),
    "not there": ({"error": urllib.error.HTTPError(GNM_URL, 404, "Not Found", None, None)}, "HTTP 404 Not Found"),
    "a reset": ({"error": ConnectionResetError("reset")}, "cannot be downloaded .reset"),
    "a redirection to http": ({"address": "http://somewhere/gnm_head.npz"}, "redirected to an address that is not"),
    "an error page": ({"content": b"<html></html>"}, "is no head model"),
    "half a file": ({"content": b"PK\x03\x04" + bytes(100)}, "is no head model"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_anything_else_is_one_line_and_leaves_no_file(case, server, tmp_path, capsys):
    changes, says = REFUSED[case]
    vars(server).update(changes)
    (folder := tmp_path / "models").mkdir()
    with pytest.raises(InputError, match=says):
        fetch_head(GNM_URL, folder / "gnm.npz")
    assert main(["head", "fetch", "gnm", "-o", str(folder / "gnm.npz")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"carigs: {GNM_URL}: ")
    assert list(folder.iterdir()) == []


def test_the_size_is_limited(server, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "MAX_DOWNLOAD_BYTES", 1000)
    with pytest.raises(InputError, match="more than 1000 bytes"):
        fetch_head(GNM_URL, tmp_path / "models" / "gnm.npz")


def test_other_schemes_are_refused(server, tmp_path):
    with pytest.raises(InputError, match="only https"):
        fetch_head("file:///etc/passwd", tmp_path / "gnm.npz")
