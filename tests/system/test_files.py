"""Atomic writes and checked reads."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.readers.json_files import json_field, read_json
from carigs.readers.npz import read_npz
from carigs.system.files import clean_results, resuming_folder, write_json, writing
from carigs.system.processes import this_process


def test_a_failed_write_leaves_the_earlier_file(tmp_path):
    write_json(tmp_path / "a.json", {"x": [1, 2]})
    with pytest.raises(RuntimeError), writing(tmp_path / "a.json") as part:
        part.write_text("half")
        raise RuntimeError
    assert read_json(tmp_path / "a.json", dict) == {"x": [1, 2]}
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_an_interrupted_folder_is_resumed_with_the_same_key_only(tmp_path):
    def interrupted(key: str) -> list[str]:
        with pytest.raises(RuntimeError), resuming_folder(tmp_path / "out", key) as (contents, _):
            found = [file.name for file in contents.iterdir()]
            (contents / "first").touch()
            raise RuntimeError
        return found

    assert interrupted("one") == []
    assert interrupted("one") == ["first"]
    assert interrupted("two") == []
    assert not (tmp_path / "out").exists()


WRITE = """
import os, signal, sys
from pathlib import Path
from carigs.system.files import resuming_folder, writing, writing_folder
folder = Path(sys.argv[1])
with writing(folder / "a.npz") as part, writing_folder(folder / "images") as images:
    with resuming_folder(folder / "targets", "key") as (contents, _), writing(contents / "inspection.png") as nested:
        for file in (part, images / "1.png", contents / "1.png", nested):
            file.touch()
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def killed(tmp_path):
    """What a killed process leaves: a file, a folder, and a state that holds another one."""
    subprocess.run([sys.executable, "-c", WRITE, str(tmp_path)])
    assert len(list(tmp_path.rglob("*.part*"))) == 4
    return tmp_path


def names(folder) -> set[str]:
    return {file.name for file in folder.rglob("*")}


def test_what_a_killed_process_left_is_removed_by_the_next_writer(killed):
    write_json(killed / "other.json", {})
    with resuming_folder(killed / "targets", "key") as (contents, _):
        assert names(contents) == {"1.png"}
    assert names(killed) == {"other.json", "targets", "1.png"}


def test_what_a_killed_process_left_is_removed_at_the_start_of_a_run(killed):
    state = {".targets.part", "contents", "notes", "key", "1.png"}
    clean_results(killed)
    assert state <= names(killed)
    assert not {name for name in names(killed) - state if "inspection" not in name}
    for path in [*killed.rglob("*"), *killed.rglob("*/*")]:
        os.utime(path, (0, 0))
    clean_results(killed)
    assert names(killed) == set()


def test_what_a_live_process_or_another_host_writes_is_kept(tmp_path):
    with writing(tmp_path / "a.json") as mine:
        mine.touch()
        other = mine.with_name(mine.name.replace(".part", "2.part"))
        other.touch()
        clean_results(tmp_path)
        write_json(tmp_path / "b.json", {})
        assert names(tmp_path) == {mine.name, other.name, "b.json"}


@pytest.mark.parametrize(
    "change",
    [
        lambda process: process._replace(system="00000000"),  # another container, or before the system was started
        lambda process: process._replace(host="another"),
        lambda process: process._replace(system="00000000", pid=process.pid + 1),
    ],
)
def test_what_an_unknown_process_writes_is_removed_only_when_no_job_runs(tmp_path, change):
    """Containers of one host name count processes anew: the number of a live process of another one is dead here."""
    with writing(tmp_path / "a.json") as mine:
        mine.touch()
        host, system, pid, start = change(this_process())
        foreign = tmp_path / f".a.{pid}-{start}-{system}-{host}.part.json"
        foreign.touch()
        write_json(tmp_path / "b.json", {})
        clean_results(tmp_path)
        assert foreign.exists() and mine.exists()
        clean_results(tmp_path, no_job_runs=True)
        assert not foreign.exists() and mine.exists()


def test_a_long_name_can_be_written(tmp_path):
    file = tmp_path / f"{'ä' * 120}.json"
    write_json(file, {})
    assert names(tmp_path) == {file.name}


def test_arrays_of_an_archive_are_read_and_checked(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, points=np.ones((4, 3), np.float32), bad=np.array([0.0, np.nan]))
    arrays = read_npz(file, required=["points"])
    points = checked_array(arrays, "points", (None, 3), np.float64, file=file)
    assert points.shape == (4, 3) and points.dtype == np.float64
    for name, shape, problem in (
        ("points", (4, 2), r"shape \(4, 3\), expected 4 x 2"),
        ("points", (None,), "expected *"),
        ("bad", None, r"not a finite number at \(1,\)"),
        ("other", None, "this array is missing"),
    ):
        with pytest.raises(InputError, match=rf"a\.npz: {name}: .*{problem}"):
            checked_array(arrays, name, shape, file=file)


@pytest.mark.parametrize(
    ("content", "problem"),
    [(None, "no such head"), (b"junk", r"not a readable \.npz"), (b"PK\x03\x04", r"not a readable \.npz")],
)
def test_unreadable_archives_are_reported_in_one_line(tmp_path, content, problem):
    file = tmp_path / "a.npz"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match=rf"a\.npz: {problem}"):
        read_npz(file, "head")


def test_a_missing_required_array_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.zeros(1))
    with pytest.raises(InputError, match=r"a\.npz: y: this array is missing"):
        read_npz(tmp_path / "a.npz", required=["x", "y"])


@pytest.mark.parametrize(
    ("text", "kind", "problem"),
    [
        (None, dict, "no such file"),
        ('{"a": [}', dict, "line 1 column 8: broken JSON"),
        ("[]", dict, "expected an object"),
        ("{}", list, "expected a list"),
    ],
)
def test_unusable_json_is_reported_with_its_place(tmp_path, text, kind, problem):
    if text is not None:
        (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=rf"a\.json: {problem}"):
        read_json(tmp_path / "a.json", kind)


@pytest.mark.parametrize(
    ("value", "kind", "problem"),
    [
        (True, int, "expected a whole number, found True"),
        (1.5, int, "expected a whole number, found 1.5"),
        ("wide", float, "expected a number, found 'wide'"),
        (float("inf"), float, "expected a number, found inf"),
        (3, str, "expected a string, found 3"),
        ({}, list, "expected a list, found {}"),
    ],
)
def test_json_fields_are_checked_by_type(value, kind, problem):
    with pytest.raises(InputError, match=rf"a\.json: frames\[2\]\.x: {problem}"):
        json_field({"x": value}, "x", kind, file="a.json", where="frames[2]")


def test_valid_json_fields_are_returned():
    entry = json.loads('{"n": 3, "x": 2.5, "name": "a"}')
    assert [json_field(entry, key, kind, file="a") for key, kind in (("n", int), ("n", float), ("x", float))] == [
        3, 3, 2.5,
    ]  # fmt: skip
    with pytest.raises(InputError, match=r"a: y: this key is missing"):
        json_field(entry, "y", int, file="a")
    with pytest.raises(InputError, match=r"a: \[0\]\.y: this key is missing"):
        json_field("text", "y", int, file="a", where="[0]")
