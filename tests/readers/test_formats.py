"""A file of an earlier or a later version says so, and what to do; a file of another kind says which."""

import json

import numpy as np
import pytest
from avatars import ball_avatar
from miniature import ball_model

from carigs.capture import Capture
from carigs.capture.frame_index import read_ground_truth, write_ground_truth
from carigs.capture.target_index import read_targets, write_targets
from carigs.errors import InputError
from carigs.exaggeration import GammaPath
from carigs.head import HeadModel
from carigs.readers.formats import Format, check_format
from carigs.splat.avatar import load_avatar, save_avatar
from evaluation.card.card import read_card

FORMAT = Format("carigs-thing", 3, "make it again")


def problem_of(found):
    with pytest.raises(InputError) as raised:
        check_format(found, FORMAT, "a.npz")
    assert str(raised.value).startswith("a.npz: format: ")
    return raised.value.problem


def test_the_version_that_is_written_is_read():
    check_format(str(FORMAT), FORMAT, "a.npz")


@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_earlier_version_has_a_remedy(number):
    problem = problem_of(f"carigs-thing-{number}")
    assert "an earlier version of carigs" in problem and problem.endswith("make it again")


@pytest.mark.parametrize("number", [4, 10, 30, 999999])
def test_a_newer_version_wants_an_upgrade(number):
    """As numbers: 10 is more than 3, though it comes before it in the alphabet."""
    problem = problem_of(f"carigs-thing-{number}")
    assert "a newer version of carigs" in problem and problem.endswith("upgrade carigs")


def test_another_format_is_named():
    assert problem_of("carigs-avatar-3") == "not a carigs-thing-3 file, but carigs-avatar-3"


@pytest.mark.parametrize("found", [None, 3, "", "thing-3", "carigs-thing", "carigs-thing-x", "carigs-thing-3 ", ["x"]])
def test_what_is_no_format_is_not_quoted(found):
    assert problem_of(found) == "not a carigs-thing-3 file"


def stating(file, number):
    """The same file with another version."""
    if file.suffix == ".json":
        content = json.loads(file.read_text())
        file.write_text(json.dumps({**content, "format": f"{content['format'].rpartition('-')[0]}-{number}"}))
    else:
        with np.load(file) as archive:
            arrays = dict(archive)
        arrays["format"] = np.array(f"{str(arrays['format']).rpartition('-')[0]}-{number}")
        np.savez(file, **arrays)
    return file


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A file of every format that a program of another age may have written, and its reader."""
    folder = tmp_path_factory.mktemp("formats")
    avatar = ball_avatar(lit=False)
    save_avatar(folder / "avatar.npz", avatar)
    avatar.sequence.path.save(folder / "path.npz")
    ball_model(subdivisions=1).save(folder / "head.npz")
    write_ground_truth(folder / "truth.json", 0.1, [])
    write_targets(folder / "targets.json", 0.1, folder, [], [])
    (folder / "capture.json").write_text('{"format": "carigs-capture-2"}')
    (folder / "card.json").write_text('{"format": "carigs-card-1"}')
    return folder


READERS = {
    "avatar.npz": load_avatar,
    "path.npz": GammaPath.load,
    "head.npz": HeadModel.load,
    "truth.json": read_ground_truth,
    "targets.json": lambda file: read_targets(file, None),
    "capture.json": Capture.load,
    "card.json": read_card,
}


@pytest.mark.parametrize("name", READERS)
def test_every_reader_knows_its_versions(name, written):
    for number, age in ((0, "an earlier version"), (99, "a newer version")):
        with pytest.raises(InputError, match=rf"{name}: format: {age} of carigs"):
            READERS[name](stating(written / name, number))


@pytest.mark.parametrize("name", ["path.npz", "head.npz", "truth.json"])
def test_files_from_before_their_formats_had_versions_are_read(name, written, tmp_path):
    if name == "truth.json":
        (tmp_path / name).write_text('{"level": 0.1, "reason": null, "frames": []}')
    else:
        with np.load(written / name) as archive:
            np.savez(tmp_path / name, **{key: archive[key] for key in archive if key != "format"})
    READERS[name](tmp_path / name)


def test_an_avatar_is_no_head_model(written):
    with pytest.raises(InputError, match="format: not a carigs-head-1 file, but carigs-avatar"):
        HeadModel.load(written / "avatar.npz")


@pytest.mark.parametrize("stated", [np.bytes_(b"carigs-path-1"), 3, ["carigs-path-1"], True, np.zeros((0,), "U1")])
def test_a_format_that_is_no_text_is_told_what_is_expected(tmp_path, stated):
    np.savez(tmp_path / "a.npz", format=stated, levels=[0.0])
    with pytest.raises(
        InputError, match=r"a\.npz: format: expected one text, found .*: not a carigs-path-1 file"
    ) as raised:
        GammaPath.load(tmp_path / "a.npz")
    assert "b'" not in str(raised.value)
