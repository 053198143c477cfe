"""Files that systems leave behind change nothing at the doors that list a folder."""

from pathlib import Path

import pytest
from calibrations import write_images
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.dataset_writer import check_target
from carigs.capture.importers.flame_tracks import read_flame_track
from carigs.capture.importers.images import find_images
from carigs.capture.importers.mesh_sequence import read_mesh_sequence
from carigs.config.folders import known
from carigs.errors import InputError
from carigs.head import HeadModel
from carigs.readers.folders import is_system_file, listed
from carigs.runs.outside_files import files_digest

JUNK = (
    "._{name}", ".DS_Store", "Thumbs.db", "desktop.ini", "Desktop.ini", "__MACOSX/{name}", "__MACOSX/._{name}",
    "@eaDir/{name}", "@eaDir/{name}/SYNOPHOTO_THUMB_XL{suffix}", ".ipynb_checkpoints/{name}", "#recycle/{name}",
    "$RECYCLE.BIN/{name}", ".Trashes/{name}", ".{name}.swp", "{name}~", "#{name}#", ".#{name}", ".hidden{suffix}",
)  # fmt: skip


def litter(folder: Path, name: str) -> list[Path]:
    """Leave files of every system in a folder, with a name that its own files have."""
    files = [folder / junk.format(name=name, suffix=Path(name).suffix) for junk in JUNK]
    for file in files:
        if not any(parent.is_file() for parent in file.parents) and not file.is_dir():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(b"\0\5\x16\7 no picture")
    return files


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


def test_images_by_camera_and_timestep(ball, tmp_path):
    write_images(tmp_path, read_dataset(ball, ball / "head_model.npz"))
    found = find_images(tmp_path / "images")
    litter(tmp_path / "images/left", "0000.png")
    litter(tmp_path / "images", "00000_left.png")
    assert find_images(tmp_path / "images") == found


@pytest.mark.parametrize("suffix", [".tif", ".webp", ".JXL"])
def test_images_of_other_formats_are_refused_rather_than_passed(ball, tmp_path, suffix):
    write_images(tmp_path, read_dataset(ball, ball / "head_model.npz"))
    (tmp_path / f"images/right/0001{suffix}").write_bytes(b"II*\0")
    with pytest.raises(InputError, match=rf"0001\{suffix}: \{suffix} is not read; convert it to PNG or JPEG"):
        find_images(tmp_path / "images")


def test_parameters_and_meshes(ball, tmp_path):
    model = HeadModel.load(ball / "head_model.npz")
    before = read_flame_track(ball / "flame_param", model)
    litter(ball / "flame_param", "00000.npz")
    assert read_flame_track(ball / "flame_param", model).keys() == before.keys()
    for t in range(3):
        corners = "".join(f"v {x} {y} {t}\n" for x, y in ((0, 0), (1, 0), (0, 1), (1, 1 + t)))
        (tmp_path / f"{t}.obj").write_text(f"{corners}f 1 2 3\nf 2 4 3\n")
    litter(tmp_path, "1.obj")
    assert read_mesh_sequence(tmp_path).parameters.keys() == {0, 1, 2}


def test_an_output_folder_with_nothing_but_system_files_is_empty(tmp_path):
    for name in (".DS_Store", "._x", "Thumbs.db", "desktop.ini"):
        (tmp_path / name).touch()
    check_target(tmp_path)
    (tmp_path / ".git").mkdir()  # hidden, but somebody misses it
    with pytest.raises(InputError, match="is not empty; nothing is overwritten"):
        check_target(tmp_path)


def test_an_input_has_not_changed_when_a_system_writes_into_its_folder(tmp_path):
    (tmp_path / "a.png").write_bytes(b"a")
    before = files_digest(tmp_path)
    (tmp_path / ".DS_Store").touch()
    (tmp_path / "._a.png").touch()
    assert files_digest(tmp_path) == before
    (tmp_path / ".a.png").touch()  # an index may name a hidden file
    assert files_digest(tmp_path) != before


def test_configurations_of_the_user(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf/variant").mkdir(parents=True)
    (tmp_path / "conf/variant/mine.yaml").write_text("# @package _global_\n")
    litter(tmp_path / "conf/variant", "mine.yaml")
    assert [name for name in known("variant") if "mine" in name or name.startswith(".")] == ["mine"]


@pytest.mark.parametrize(
    "name", ["00000.png", "a~b.png", "cam#1", "thumbs.png", "x.DS_Store.png", "_00000.png", "$a.png"]
)
def test_other_names_are_meant(tmp_path, name):
    (tmp_path / name).touch()
    assert listed(tmp_path) == [tmp_path / name] and not is_system_file(name)


@pytest.mark.parametrize("name", ["#left", "left~", "~$left", ".#left"])
def test_folders_that_are_named_like_copies_of_editors_are_meant(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "0.png").touch()
    (tmp_path / name / "0.png~").touch()
    expected = [] if name.startswith(".") else [tmp_path / name, tmp_path / name / "0.png"]
    assert listed(tmp_path, "**/*") == expected


@pytest.mark.parametrize("below", ["", "below", "below/it"])
def test_a_dataset_cannot_be_made_where_a_file_is(tmp_path, below):
    (tmp_path / "taken").write_text("something")
    with pytest.raises(InputError, match="taken: is a file; the output is a folder; remedy"):
        check_target(tmp_path / "taken" / below)
    check_target(tmp_path / "new" / below)


def test_a_dataset_cannot_be_made_where_nothing_can_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: False)  # the superuser may write everywhere
    with pytest.raises(InputError, match="cannot be written to"):
        check_target(tmp_path / "new" / "dataset")
