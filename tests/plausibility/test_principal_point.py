"""The convention of cy is found by outlines, whatever the files hold."""

import json
import shutil
from pathlib import Path

import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.images import read_grey, read_rgb, write_png
from carigs.errors import InputError
from carigs.plausibility import check_capture, resolve_cy

ROWS = 6
"""Rows that are cut off the images."""


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "ball"))


def crop(folder: Path, *, top: bool, flipped: bool) -> None:
    """Cut rows off at one end, which moves the principal point."""
    rows = slice(ROWS, None) if top else slice(None, -ROWS)
    for kind, read in (("images", read_rgb), ("fg_masks", read_grey)):
        for file in (folder / kind).iterdir():
            write_png(file, read(file)[rows])
    for split in ("train", "val", "test"):
        file = folder / f"transforms_{split}.json"
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            entry["h"] -= ROWS
            entry["cy"] -= ROWS if top else 0
            if flipped:
                entry["cy"] = entry["h"] - entry["cy"]
        file.write_text(json.dumps(content))


def read(folder: Path):
    return read_dataset(folder, folder / "head_model.npz")


@pytest.mark.sample(3)
@pytest.mark.parametrize("top", [False, True])
@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("mattes", [False, True])
def test_either_convention_is_found(dataset, top, flipped, mattes):
    truth = read(dataset).calibrations[0].cy - ROWS * top
    crop(dataset, top=top, flipped=flipped)
    if not mattes:
        for split in ("train", "val", "test"):
            file = dataset / f"transforms_{split}.json"
            content = json.loads(file.read_text())
            content["frames"] = [{k: v for k, v in e.items() if k != "fg_mask_path"} for e in content["frames"]]
            file.write_text(json.dumps(content))
    found = resolve_cy(read(dataset))
    assert found.cy.startswith("flipped" if flipped else "opencv")
    assert all(camera.cy == pytest.approx(truth) for camera in found.calibrations)
    kinds = [line for line in check_capture(found).warnings if "frames have no matte" not in line]
    assert kinds == [] and (len(check_capture(found).warnings) == (not mattes))


def test_a_setting_needs_no_evidence(dataset):
    crop(dataset, top=True, flipped=True)
    before = read(dataset)
    assert resolve_cy(before, "opencv").calibrations == before.calibrations
    flipped = resolve_cy(before, "flipped")
    assert [c.cy for c in flipped.calibrations] == [c.height - c.cy for c in before.calibrations]


def test_a_centred_principal_point_does_not_matter(dataset):
    before = read(dataset)
    found = resolve_cy(before)
    assert found.calibrations == before.calibrations and "does not matter" in found.cy and found.warnings == ()


def test_what_outlines_cannot_tell_is_refused_with_the_setting(dataset):
    """Mattes that are full but for a pixel have no outline."""
    crop(dataset, top=True, flipped=False)
    for file in (dataset / "fg_masks").iterdir():
        matte = 0 * read_grey(file) + 1
        matte[0, 0] = 0
        write_png(file, matte)
    with pytest.raises(InputError, match=r"ball: cy: the principal point .* set capture\.cy to opencv or flipped"):
        resolve_cy(read(dataset))
