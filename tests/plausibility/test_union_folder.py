"""A folder in the layout of GaussianAvatars' NeRSemble data: sequences side by side, united by relative paths."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.images import read_grey, read_rgb, write_png
from carigs.cli.main import main
from carigs.errors import InputError
from carigs.plausibility import check_capture

SEQUENCES = (
    "306_EMO-1_v16_DS4_whiteBg_staticOffset_maskBelowLine",
    "306_EXP-2_v16_DS4_whiteBg_staticOffset_maskBelowLine",
)
FILES = ("file_path", "fg_mask_path", "flame_param_path")
MASK_LINE = 0.7
"""Height of the line below which image and matte are masked, in heights of the image."""


@pytest.fixture
def union(tmp_path) -> Path:
    """The miniature subject: the training timesteps in one sequence, the test timestep in another."""
    ball, folder = write_ball(tmp_path / "ball"), tmp_path / "data/UNION10_306_EMO1234EXP234589_v16_maskBelowLine"
    folder.mkdir(parents=True)
    for split in ("train", "val", "test"):
        content = json.loads((ball / f"transforms_{split}.json").read_text())
        sequence = SEQUENCES[split == "test"]
        for entry in content["frames"]:
            del entry["sequence"]
            for key in FILES:
                target = folder.parent / sequence / entry[key]
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ball / entry[key], target)
                entry[key] = f"../{sequence}/{entry[key]}"
        (folder / f"transforms_{split}.json").write_text(json.dumps(content))
    for file in folder.parent.rglob("*.png"):
        mask = file.parent.name == "fg_masks"
        image = read_grey(file) if mask else read_rgb(file)
        image[int(MASK_LINE * len(image)) :] = 0 if mask else 1
        write_png(file, image)
    np.savez(folder / "canonical_flame_param.npz", jaw_pose=np.array([[0.3, 0, 0]]))
    shutil.copyfile(ball / "head_model.npz", tmp_path / "flame2023.npz")
    return folder


def test_it_is_read_without_a_warning(union):
    capture = check_capture(read_dataset(union, union.parents[1] / "flame2023.npz"))
    assert capture.warnings == ()
    assert {frame.sequence for frame in capture.split("test")} == {"EXP-2"}


def crop(folder: Path, left: int = 3, top: int = 5) -> None:
    """Move the principal points off the middle of the images."""
    for file in folder.parent.rglob("*.png"):
        mask = file.parent.name == "fg_masks"
        write_png(file, (read_grey(file) if mask else read_rgb(file))[top:, left:])
    for file in folder.glob("transforms_*.json"):
        content = json.loads(file.read_text())
        for entry in content["frames"]:
            for key, pixels in (("cx", left), ("cy", top), ("w", left), ("h", top)):
                entry[key] -= pixels
        file.write_text(json.dumps(content))


@pytest.mark.sample(1)
@pytest.mark.parametrize("change", [lambda folder: None, crop], ids=["centred", "off-centre"])
def test_the_check_raises_no_false_alarm(union, capsys, change):
    """It is true that the files take one of three cameras away from the training."""
    change(union)
    assert main(["check", str(union), "--head-model", str(union.parents[1] / "flame2023.npz")]) == 0
    lines = "errors: none", "warnings: 1", "  the split takes one of 3 cameras away from the training"
    assert "\n".join(lines) in capsys.readouterr().out


def test_a_linked_sequence_is_followed(union, tmp_path):
    """Sequences may lie on another disk."""
    sequence = union.parent / SEQUENCES[0]
    (tmp_path / "disk").mkdir()
    sequence.rename(tmp_path / "disk/sequence")
    sequence.symlink_to(tmp_path / "disk/sequence", target_is_directory=True)
    assert check_capture(read_dataset(union, tmp_path / "flame2023.npz")).warnings == ()


@pytest.mark.parametrize("key", FILES)
def test_paths_beyond_the_neighbouring_folders_are_refused(union, key):
    file = union / "transforms_test.json"
    content = json.loads(file.read_text())
    content["frames"][1][key] = "../" + content["frames"][1][key]
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"test\.json: frames\[1\]\.{key}: .* folder beside it"):
        read_dataset(union, union.parents[1] / "flame2023.npz")
