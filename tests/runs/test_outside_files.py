"""The digest of what settings name changes with its files, and with nothing else."""

import json
import os
import shutil
from dataclasses import fields

import pytest
from miniature import write_ball

from carigs.config import compose
from carigs.readers.file_names import BESIDE_FLAME
from carigs.runs.outside_files import files_digest, outside_files
from carigs.settings import STAGES
from carigs.settings.option import option_of


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(ball, tmp_path):
    return shutil.copytree(ball, tmp_path / "ball")


def test_reading_files_leaves_the_digest(dataset):
    before = files_digest(dataset)
    for file in dataset.rglob("*.*"):
        file.read_bytes()
    (dataset / "notes.txt").write_text("not named by the dataset")
    assert files_digest(dataset) == before


@pytest.mark.parametrize(
    "name", ["transforms_train.json", "images/00001_02.png", "fg_masks/00001_02.png", "flame_param/00002.npz",
]
)  # fmt: skip
@pytest.mark.parametrize("change", ["longer", "newer", "gone"])
def test_a_changed_file_changes_the_digest(dataset, name, change):
    before, file = files_digest(dataset), dataset / name
    if change == "longer":
        status = file.stat()
        file.write_bytes(file.read_bytes() + b" ")
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    elif change == "newer":
        os.utime(file, ns=(0, file.stat().st_mtime_ns + 1_000_000_000))
    else:
        file.unlink()
    assert files_digest(dataset) != before


def test_frames_in_the_folders_of_cameras_count(tmp_path):
    for camera in ("left", "right"):
        (tmp_path / camera).mkdir()
        (tmp_path / camera / "0.png").write_bytes(b"0")
    before = files_digest(tmp_path)
    assert files_digest(tmp_path) == before
    (tmp_path / "right" / "0.png").write_bytes(b"01")
    assert files_digest(tmp_path) != before


def test_files_of_neighbouring_sequences_count(dataset):
    union = dataset.parent / "UNION"
    union.mkdir()
    for split in ("train", "val", "test"):
        content = json.loads((dataset / f"transforms_{split}.json").read_text())
        for entry in content["frames"]:
            for key in ("file_path", "fg_mask_path", "flame_param_path"):
                entry[key] = f"../ball/{entry[key]}"
        (union / f"transforms_{split}.json").write_text(json.dumps(content))
    before = files_digest(union)
    os.utime(dataset / "images/00001_02.png", ns=(0, 0))
    assert files_digest(union) != before


@pytest.mark.parametrize(
    ("folder", "written"),
    [
        ("b\u00fcste", "b\\u00fcste"),  # as json.dumps writes it
        ("b\u00fcste", "b\u00fcste"),
        ("a/b", "a\\/b"),
        ('a"b', 'a\\"b'),
        ("\U0001f600", "\\ud83d\\ude00"),
    ],
)
def test_names_count_however_json_writes_them(dataset, folder, written):
    (dataset / folder).parent.mkdir(exist_ok=True)
    (dataset / "images").rename(dataset / folder)
    for index in dataset.glob("transforms_*.json"):
        index.write_text(index.read_text().replace('"images/', f'"{written}/'), "utf-8")
    before = files_digest(dataset)
    os.utime(dataset / folder / "00001_02.png", ns=(0, 0))
    assert files_digest(dataset) != before


@pytest.mark.parametrize("suffix", [".JPG", ".webp", ".npy", ".exr"])
def test_files_of_any_kind_count_under_any_key(dataset, suffix):
    index = dataset / "transforms_train.json"
    content = json.loads(index.read_text())
    content["frames"][0]["labels"] = f"labels/one{suffix}"
    index.write_text(json.dumps(content))
    (dataset / "labels").mkdir()
    before = files_digest(dataset)
    (dataset / f"labels/one{suffix}").touch()
    assert files_digest(dataset) != before


@pytest.mark.parametrize("text", ["", "{", "[" * 100000, "\ud800", "3"])
def test_an_index_that_cannot_be_parsed_counts_itself(dataset, text):
    (dataset / "transforms_train.json").write_bytes(text.encode("utf-8", "surrogatepass"))
    before = files_digest(dataset)
    (dataset / "transforms_train.json").write_text("[1]")
    assert files_digest(dataset) != before


def test_what_is_not_there_has_no_digest(tmp_path):
    assert files_digest(tmp_path / "nothing") == files_digest("a\0b") == ""
    assert files_digest(tmp_path) != ""


def test_a_folder_without_index_is_its_files_and_not_those_below(tmp_path):
    (tmp_path / "below").mkdir()
    (tmp_path / "own.png").touch()
    before = files_digest(tmp_path)
    (tmp_path / "below/a.png").touch()
    assert files_digest(tmp_path) == before
    (tmp_path / "00000_01.png").touch()
    assert files_digest(tmp_path) != before


def test_what_is_read_beside_a_head_model_counts(tmp_path):
    masks, *_ = BESIDE_FLAME
    model = tmp_path / "flame.pkl"
    (tmp_path / masks).touch()
    assert files_digest(model) == ""
    model.touch()
    (tmp_path / "notes.txt").touch()
    with_masks = files_digest(model)
    (tmp_path / masks).unlink()
    assert files_digest(model) != with_masks


def test_every_setting_that_names_a_file_is_marked():
    """Names of files are the only texts that may be missing and have no pattern."""

    def names_a_file(field):
        return "str | None" in str(field.type) and not option_of(field).pattern

    named = {stage: {f.name for f in fields(STAGES[stage]) if names_a_file(f)} for stage in STAGES}
    marked = {stage: {f.name for f in fields(STAGES[stage]) if option_of(f).is_path} for stage in STAGES}
    assert marked == named


@pytest.mark.parametrize(
    ("stage", "overrides", "expected"),
    [
        ("capture", ["capture.folder=anna", "capture.head_model=flame.pkl"], []),  # the source is the toy
        (
            "capture",
            ["capture.source=folder", "capture.folder=anna", "capture.head_model=flame.pkl"],
            ["anna", "flame.pkl"],
        ),
        ("exaggerate", ["exaggerate.file='{gamma}.obj'", "gamma=0.5"], ["0.5.obj"]),
        ("gtstar", ["gtstar.provider=precomputed", "gtstar.folder=edited"], ["edited"]),
        ("gtstar", ["gtstar.provider=command", f"gtstar.command=[python,{__file__},--fast]"], [__file__]),
        ("gtstar", [f"gtstar.command=[python,{__file__}]"], []),  # another provider
        ("train", ["train.start=a.npz"], ["a.npz"]),
        ("truth", ["truth.folder='truth/level={level}'"], ["truth/level=0.25"]),
        ("metrics", ["metrics.weights=weights"], ["weights"]),
        ("render", [], []),
    ],
)
def test_the_files_of_a_stage_are_those_that_its_settings_use(stage, overrides, expected):
    section = compose(*overrides)[stage]
    assert [str(path) for path in outside_files(stage, section, 0.25).values()] == expected
