"""Members of an archive are what was written, or refused; and AVIF images likewise."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from dome_captures import avif, write_zip
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import InputError
from carigs.readers import images
from carigs.readers.archives import Archive
from carigs.readers.images import parse_avif

CONTENT = {"cam1/000001.bin": bytes(range(256)) * 4, "000002.txt": b"1 2 3\n", "empty": b""}
LIMIT = 10_000


def read_all(file: Path) -> dict[str, bytes]:
    with Archive(file) as archive:
        return {name: archive.read(name, LIMIT) for name in archive.names}


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_what_was_written_is_read(tmp_path, compression):
    with zipfile.ZipFile(tmp_path / "a.zip", "w", compression) as archive:
        archive.mkdir("cam1")
        for name, content in CONTENT.items():
            archive.writestr(name, content)
    assert read_all(tmp_path / "a.zip") == CONTENT


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("archive") / "sound.zip"
    write_zip(file, CONTENT)
    return file


@given(data=st.data())
def test_damage_is_noticed_or_changes_no_content(sound, data):
    content = bytearray(sound.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.sampled_from([len(content), *range(0, len(content), 97)]))
    file = sound.with_name("damaged.zip")
    file.write_bytes(content[:cut])
    try:
        found = read_all(file)
    except InputError as error:
        assert "damaged.zip" in str(error)
        return
    assert {*found.values()} <= {*CONTENT.values()}  # names have no checksum


def test_a_member_that_is_larger_than_it_states_is_not_unpacked(tmp_path):
    """A bomb: the directory states 10 bytes, the data unpack to a million."""
    file = tmp_path / "bomb.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(1_000_000))
    with pytest.raises(InputError, match=r"bomb\.zip: a: 1000000 bytes; at most 10000 are read"):
        read_all(file)
    content = file.read_bytes()
    stated = struct.pack("<I", 1_000_000)
    assert content.count(stated) == 2  # of the member and of the directory
    file.write_bytes(content.replace(stated, struct.pack("<I", 10)))
    with pytest.raises(InputError, match=r"bomb\.zip: a: damaged in the archive"):
        read_all(file)


def test_what_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.zip: no such archive"):
        Archive(tmp_path / "none.zip")
    with zipfile.ZipFile(tmp_path / "twice.zip", "w") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("a", b"1")
        archive.writestr("a", b"2")
    with pytest.raises(InputError, match=r"twice\.zip: two members have one name"):
        Archive(tmp_path / "twice.zip")
    with zipfile.ZipFile(tmp_path / "bz.zip", "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("a", b"1")
    with pytest.raises(InputError, match=r"bz\.zip: a: compressed in a way that is not read"):
        read_all(tmp_path / "bz.zip")
    write_zip(tmp_path / "sound.zip", CONTENT)
    with Archive(tmp_path / "sound.zip") as archive, pytest.raises(InputError, match="b: no such file in the archive"):
        archive.read("b", LIMIT)


def test_nothing_is_written_outside(tmp_path):
    """Names that lead elsewhere are names."""
    write_zip(tmp_path / "in/slip.zip", {"../slipped": b"1", "/slipped": b"2"})
    assert read_all(tmp_path / "in/slip.zip") == {"../slipped": b"1", "/slipped": b"2"}
    assert [path.name for path in tmp_path.rglob("*")] == ["in", "slip.zip"]


PICTURE = np.random.default_rng(2).integers(0, 256, (24, 16, 3), np.uint8)


def test_avif_keeps_colours_and_their_order():
    assert np.abs(parse_avif(avif(PICTURE), "a.avif").astype(int) - PICTURE).max() <= 8


def test_avif_of_too_many_pixels(monkeypatch):
    monkeypatch.setattr(images, "MAX_IMAGE_PIXELS", 24 * 16 - 1)
    with pytest.raises(InputError, match=r"a\.avif: 16 x 24 pixels are more than are decoded"):
        parse_avif(avif(PICTURE), "a.avif")


@given(data=st.data())
def test_damaged_avif_is_refused_or_an_image(data):
    content = bytearray(avif(PICTURE))
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        found = parse_avif(bytes(content[: data.draw(st.integers(0, len(content)))]), "a.avif")
    except InputError as error:
        assert str(error).startswith("a.avif: ") and "\n" not in str(error)
        return
    assert found.dtype == np.uint8 and found.ndim == 3 and found.shape[2] == 3
