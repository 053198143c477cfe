"""Frames that are held out."""

from itertools import pairwise

import pytest

from carigs.capture.splits import blocks, last_quarter
from carigs.tracking.held_out import SPLITS, held_out, views


@pytest.mark.parametrize("name", SPLITS)
@pytest.mark.parametrize("count", [10, 12, 17, 20, 57, 400])
def test_every_frame_has_a_split_and_most_are_for_training(name, count):
    names = SPLITS[name](count)
    assert len(names) == count and set(names) <= {"train", "val", "test"}
    assert names.count("train") >= 0.7 * count
    assert "test" in names


def test_blocks_are_spread_over_the_clip():
    held_out = [i for i, name in enumerate(blocks(200)) if name != "train"]
    assert len(held_out) == 50
    assert max(b - a for a, b in pairwise(held_out)) == 16
    assert blocks(200).count("val") == 10


def test_the_last_quarter_follows_all_training_frames():
    names = last_quarter(80)
    assert names[:60] == ["train"] * 60 and "train" not in names[60:]
    assert names[60:].count("val") == 4


@pytest.mark.parametrize("cameras", [2, 3, 5])
def test_few_cameras_are_held_out_by_time_alone(cameras):
    names = held_out(40, cameras, frontal=1)
    assert names == [[name] * cameras for name in blocks(40)]


def test_one_of_many_cameras_is_for_validation():
    names = held_out(40, 6, frontal=2)
    for row, name in zip(names, blocks(40), strict=True):
        assert row == (["train", "train", "val", *["train"] * 3] if name == "train" else ["test"] * 6)


@pytest.mark.parametrize("count", [3, 8, 20, 96])
def test_views_of_one_moment_are_held_out_between_others(count):
    names = views(count)
    assert held_out(1, count, frontal=0) == [names]
    held = [i for i, name in enumerate(names) if name != "train"]
    assert held and names[0] == names[-1] == "train"
    assert names.count("val") == (len(held) > 1)
    assert len(held) <= max(count / 7, 1)
