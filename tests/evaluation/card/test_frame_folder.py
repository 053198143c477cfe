"""Renderings of another program: found by name or by an index; everything that is wrong is said at once."""

from __future__ import annotations

import json

import numpy as np
import pytest

from carigs.capture.images import write_png
from carigs.errors import InputError
from evaluation.card.frame_folder import Wanted, find_frames

KEYS = [("test", 3, 0), ("test", 3, 1), ("orbit", 3, 0)]
WANTED = {
    level: [Wanted(key, f"{key[0]}/{key[1]:05d}_{key[2]:02d}.png", (5, 4)) for key in KEYS] for level in ("0", "0.25")
}
ALL = ("test", "orbit")


@pytest.fixture
def renderings(tmp_path):
    for level, frames in WANTED.items():
        for frame in frames:
            file = tmp_path / f"level={level}" / frame.name
            file.parent.mkdir(parents=True, exist_ok=True)
            write_png(file, np.ones((4, 5, 3)))
    return tmp_path


def test_frames_are_found_by_their_names(renderings):
    found = find_frames(renderings, WANTED, ALL)
    for level, frames in WANTED.items():
        assert found[level].keys() == set(KEYS)
        assert all(str(found[level][frame.key]).endswith(frame.name) for frame in frames)


def test_frames_are_found_by_an_index(tmp_path):
    (tmp_path / "level=0").mkdir()
    entries = []
    for i, (protocol, timestep, camera) in enumerate(KEYS):
        write_png(tmp_path / f"level=0/{i}.png", np.ones((4, 5, 3)))
        entries.append({"protocol": protocol, "timestep": timestep, "camera": camera, "file": f"{i}.png"})
    index = tmp_path / "level=0/frames.json"
    index.write_text(json.dumps(entries))
    found = find_frames(tmp_path, {"0": WANTED["0"]}, ALL)
    assert [found["0"][key].name for key in KEYS] == ["0.png", "1.png", "2.png"]
    index.write_text(json.dumps([*entries, entries[0]]))
    with pytest.raises(InputError, match="listed twice"):
        find_frames(tmp_path, {"0": WANTED["0"]}, ALL)
    index.write_text(json.dumps([{**entries[0], "file": "../../../etc/passwd"}, *entries[1:]]))
    with pytest.raises(InputError, match="inside the dataset"):
        find_frames(tmp_path, {"0": WANTED["0"]}, ALL)


def test_missing_extra_and_mis_sized_frames_are_named_in_one_error(renderings):
    files = sorted(renderings.rglob("*_01.png"))
    files[0].unlink()
    write_png(files[1], np.ones((6, 7, 3)))
    write_png(files[0].with_name("00009_00.png"), np.ones((4, 5, 3)))
    with pytest.raises(InputError) as caught:
        find_frames(renderings, WANTED, ALL)
    message = str(caught.value)
    assert "1 missing (level=0/test/00003_01.png)" in message
    assert "1 not asked for (level=0/test/00009_00.png)" in message
    assert "1 of another size (level=0.25/test/00003_01.png: 7 x 6, not 5 x 4)" in message


def test_frames_of_other_protocols_may_be_there_or_not(renderings):
    for file in renderings.rglob("orbit/*.png"):
        if "0.25" in str(file):
            file.unlink()
    found = find_frames(renderings, WANTED, ("test",))
    assert all(files.keys() == set(KEYS[:2]) for files in found.values())


def test_a_file_that_is_no_image_and_a_folder_that_is_not_there_are_errors(renderings):
    next(renderings.rglob("*.png")).write_bytes(b"not an image")
    with pytest.raises(InputError, match="images: "):
        find_frames(renderings, WANTED, ALL)
    with pytest.raises(InputError, match="no such folder"):
        find_frames(renderings / "elsewhere", WANTED, ALL)


def test_a_long_list_is_cut(tmp_path):
    with pytest.raises(InputError, match=r"6 missing .* and 3 more"):
        find_frames(tmp_path, WANTED, ALL)
