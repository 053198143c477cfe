"""The digest of a dataset changes with its files, and with nothing else."""

import json
import os
import shutil

import pytest
from miniature import write_ball

from carigs.dataset_digest import dataset_digest


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(ball, tmp_path):
    return shutil.copytree(ball, tmp_path / "ball")


def digest(folder) -> str:
    return dataset_digest(folder, folder / "head_model.npz")


def test_reading_files_leaves_the_digest(dataset):
    before = digest(dataset)
    for file in dataset.rglob("*.*"):
        file.read_bytes()
    (dataset / "notes.txt").write_text("not named by the dataset")
    assert digest(dataset) == before


@pytest.mark.parametrize(
    "name", ["transforms_train.json", "images/00001_02.png", "fg_masks/00001_02.png", "flame_param/00002.npz",
             "head_model.npz"]
)  # fmt: skip
@pytest.mark.parametrize("change", ["longer", "newer", "gone"])
def test_a_changed_file_changes_the_digest(dataset, name, change):
    before, file = digest(dataset), dataset / name
    if change == "longer":
        status = file.stat()
        file.write_bytes(file.read_bytes() + b" ")
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    elif change == "newer":
        os.utime(file, ns=(0, file.stat().st_mtime_ns + 1_000_000_000))
    else:
        file.unlink()
    assert digest(dataset) != before


def test_files_of_neighbouring_sequences_count(dataset):
    union = dataset.parent / "UNION"
    union.mkdir()
    for split in ("train", "val", "test"):
        content = json.loads((dataset / f"transforms_{split}.json").read_text())
        for entry in content["frames"]:
            for key in ("file_path", "fg_mask_path", "flame_param_path"):
                entry[key] = f"../ball/{entry[key]}"
        (union / f"transforms_{split}.json").write_text(json.dumps(content))
    before = dataset_digest(union, dataset / "head_model.npz")
    os.utime(dataset / "images/00001_02.png", ns=(0, 0))
    assert dataset_digest(union, dataset / "head_model.npz") != before


def test_a_missing_dataset_has_a_digest(tmp_path):
    assert dataset_digest(tmp_path / "nothing", tmp_path / "no.npz")
