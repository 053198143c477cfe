"""Frames that are held out."""

from itertools import pairwise

import pytest

from carigs.tracking.held_out import SPLITS, blocks, last_quarter


@pytest.mark.parametrize("name", SPLITS)
@pytest.mark.parametrize("count", [10, 20, 57, 400])
def test_every_frame_has_a_split_and_most_are_for_training(name, count):
    names = SPLITS[name](count)
    assert len(names) == count and set(names) <= {"train", "val", "test"}
    assert names.count("train") >= 0.7 * count


def test_blocks_are_spread_over_the_clip():
    held_out = [i for i, name in enumerate(blocks(200)) if name != "train"]
    assert len(held_out) == 50
    assert max(b - a for a, b in pairwise(held_out)) == 16
    assert blocks(200).count("val") == 10


def test_the_last_quarter_follows_all_training_frames():
    names = last_quarter(80)
    assert names[:60] == ["train"] * 60 and "train" not in names[60:]
    assert names[60:].count("val") == 4
