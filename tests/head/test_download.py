"""Downloads: what is not expected is refused, and nothing is replaced then."""

from __future__ import annotations

import hashlib
import urllib.error
import urllib.request

import pytest
from heads import gnm_file, gnm_like
from stress.sound_files.facekit import write_facekit
from web import FolderWeb, Web

from carigs.cli.main import main
from carigs.errors import InputError
from carigs.head import HeadModel, download
from carigs.head.download import FACEKIT, FACEKIT_CHECKSUMS, GNM, fetch_head, fetch_ict_facekit
from carigs.toy.rig.head_model import head_model


@pytest.fixture
def server(monkeypatch, tmp_path):
    web = Web(gnm_file(tmp_path, gnm_like(0)).read_bytes())
    monkeypatch.setattr(urllib.request, "urlopen", web.open)
    return web


def test_a_model_is_downloaded_with_its_checksum(server, tmp_path, capsys):
    file = tmp_path / "models" / "gnm.npz"
    assert main(["head", "fetch", "gnm", "-o", str(file)]) == 0
    digest = hashlib.sha256(server.content).hexdigest()
    assert capsys.readouterr().out == f"GNM Head v3 of Google, licence Apache-2.0\n{file}  sha256 {digest}\n"
    assert file.with_name("gnm.npz.sha256").read_text() == f"{digest}  gnm.npz\n"
    assert len(HeadModel.load(file).parents) == 4
    assert fetch_head(GNM.url, file) == digest  # again


def test_a_changed_file_is_refused(server, tmp_path):
    file = tmp_path / "gnm.npz"
    fetch_head(GNM.url, file)
    before = file.read_bytes()
    other = tmp_path / "other"
    other.mkdir()
    server.content = gnm_file(other, gnm_like(1)).read_bytes()
    with pytest.raises(InputError, match=r"has the sha256 .* as before; remove .*gnm\.npz\.sha256"):
        fetch_head(GNM.url, file)
    assert file.read_bytes() == before
    file.with_name("gnm.npz.sha256").unlink()
    assert fetch_head(GNM.url, file) == hashlib.sha256(server.content).hexdigest()


@pytest.mark.parametrize("kept", [b"", b"\xff\xfe", b"0" * 63, b"x" * 64, bytes(10**6), None])
def test_a_checksum_that_cannot_be_read_is_refused(server, kept, tmp_path):
    file = tmp_path / "gnm.npz"
    fetch_head(GNM.url, file)
    before, kept_file = file.read_bytes(), tmp_path / "gnm.npz.sha256"
    kept_file.unlink()
    kept_file.mkdir() if kept is None else kept_file.write_bytes(kept)
    with pytest.raises(InputError, match=r"gnm\.npz\.sha256: "):
        fetch_head(GNM.url, file)
    assert file.read_bytes() == before


REFUSED = {
    "no network": ({"error": urllib.error.URLError("Name or service not known")}, "cannot be downloaded .Name or ser"),
    "not there": ({"error": urllib.error.HTTPError(GNM.url, 404, "Not Found", None, None)}, "HTTP 404 Not Found"),
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
        fetch_head(GNM.url, folder / "gnm.npz")
    assert main(["head", "fetch", "gnm", "-o", str(folder / "gnm.npz")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"carigs: {GNM.url}: ")
    assert list(folder.iterdir()) == []


def test_the_size_is_limited(server, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "MAX_DOWNLOAD_BYTES", 1000)
    with pytest.raises(InputError, match="more than 1000 bytes"):
        fetch_head(GNM.url, tmp_path / "models" / "gnm.npz")


def test_other_schemes_are_refused(server, tmp_path):
    with pytest.raises(InputError, match="only https"):
        fetch_head("file:///etc/passwd", tmp_path / "gnm.npz")


MESHES = {"generic_neutral_mesh.obj", "jawOpen.obj", "mouthSmile_L.obj"}


@pytest.fixture(scope="module")
def facekit_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("FaceXModel")
    write_facekit(folder, head_model(), 2, {"jawOpen": "jaw_open", "mouthSmile_L": "mouth_smile_left"})
    return folder


@pytest.fixture
def facekit(facekit_folder, monkeypatch, tmp_path):
    """A server with two identities and two expressions, whose checksums are known, those of the identities are not."""
    served, known = tmp_path / "served", tmp_path / "known.sha256"
    served.mkdir()
    for file in facekit_folder.iterdir():
        (served / file.name).write_bytes(file.read_bytes())
    known.write_text("".join(f"{sha256(served / name)}  {name}\n" for name in sorted(MESHES)))
    monkeypatch.setattr(download, "FACEKIT_CHECKSUMS", known)
    monkeypatch.setattr(download, "FACEKIT_IDENTITIES", 2)
    web = FolderWeb(served)
    monkeypatch.setattr(urllib.request, "urlopen", web.open)
    return web


def sha256(file):
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_facekit_is_downloaded_and_converted(facekit, tmp_path, capsys):
    file = tmp_path / "models" / "ict.npz"
    assert main(["head", "fetch", "ict", "-o", str(file)]) == 0
    assert capsys.readouterr().out.startswith(f"{FACEKIT.title}, licence MIT\n{file}  sha256 ")
    model = HeadModel.load(file)
    assert (model.num_identity, model.expression_names) == (2, ("jawOpen", "mouthSmile_L"))
    assert {address.rsplit("/", 1)[0] for address, _ in facekit.asked} == {FACEKIT.url}
    kept = dict(line.split("  ")[::-1] for line in file.with_name("ict.npz.sha256").read_text().splitlines())
    assert kept == {file.name: sha256(file) for file in facekit.folder.iterdir()}
    assert {path.name for path in file.parent.iterdir()} == {"ict.npz", "ict.npz.sha256"}


def test_an_interrupted_download_of_facekit_goes_on(facekit, tmp_path):
    last = facekit.folder / "mouthSmile_L.obj"
    content = last.read_bytes()
    last.unlink()
    with pytest.raises(InputError, match=r"mouthSmile_L\.obj: .*HTTP 404"):
        fetch_ict_facekit(tmp_path / "ict.npz")
    assert not (tmp_path / "ict.npz").exists()
    last.write_bytes(content)
    facekit.asked.clear()
    fetch_ict_facekit(tmp_path / "ict.npz")
    assert [address for address, _ in facekit.asked] == [f"{FACEKIT.url}/mouthSmile_L.obj"]


@pytest.mark.parametrize(
    ("name", "fetched_before", "says"),
    [
        ("jawOpen.obj", False, r"jawOpen\.obj: has the sha256 .*; remedy: try again"),
        ("identity001.obj", True, r"identity001\.obj: has the sha256 .* as before; remove .*ict\.npz\.sha256"),
        ("identity001.obj", False, r"identity001\.obj: 1 vertices, ICT-FaceKit Light has 26719"),
    ],
)
def test_a_mesh_of_facekit_that_is_another_one_is_refused(name, fetched_before, says, facekit, tmp_path):
    file = tmp_path / "ict.npz"
    if fetched_before:
        fetch_ict_facekit(file)
    before = file.read_bytes() if fetched_before else None
    sound = (facekit.folder / name).read_bytes()
    (facekit.folder / name).write_text("v 0 0 0\nf 1 1 1\n")
    with pytest.raises(InputError, match=says):
        fetch_ict_facekit(file)
    assert (file.read_bytes() if file.exists() else None) == before
    (facekit.folder / name).write_bytes(sound)
    fetch_ict_facekit(file)  # what was refused is not kept


def test_known_checksums_are_those_of_the_neutral_mesh_and_53_expressions():
    names = [line.split("  ")[1] for line in FACEKIT_CHECKSUMS.read_text().splitlines()]
    assert len(set(names)) == 54 and {"generic_neutral_mesh.obj", "jawOpen.obj", "eyeBlink_L.obj"} <= set(names)
