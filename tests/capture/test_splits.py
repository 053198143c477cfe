"""Splits: the rules of the papers, and fewer frames."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.capture import Frame
from carigs.capture.splits import (
    ENOUGH_CAMERAS,
    blocks,
    released_test_sequence,
    split_frames,
    split_single_sequence,
    subject_number,
)
from carigs.capture.thinning import thin_frames
from carigs.errors import InputError

MANY = (0, 1, 3, 5, 8, 9)
RELEASED = {
    "074": "EMO-4", "104": "EXP-2", "140": "EMO-1", "165": "EMO-4", "175": "EXP-5", "210": "EXP-5", "218": "EXP-9",
    "238": "EMO-4", "253": "EMO-4", "264": "EXP-9", "302": "EMO-2", "304": "EXP-2", "306": "EXP-2", "460": "EMO-3",
}  # fmt: skip
"""Test sequences of GaussianAvatars' released data."""
SEQUENCES = ("EMO-1", "EMO-4", "EXP-2", "EXP-2b")
UNION = Path("UNION10_074_EMO1234EXP234589_v16_DS2-0.5x_maskBelowLine")


def frames(cameras=(0, 3, 8), steps: int = 5, missing=()) -> list[Frame]:
    """Frames of several sequences, whose files hold out the last one."""
    return [
        Frame(t, c, sequence, "test" if sequence == SEQUENCES[-1] else "train", f"{t}_{c}.png", None, f"{t}.npz", 0)
        for s, sequence in enumerate(SEQUENCES)
        for t in range(s * steps, (s + 1) * steps)
        for c in cameras
        if (t, c) not in missing
    ]


def by_split(found) -> dict[str, set]:
    return {name: {(f.sequence, f.camera) for f in found if f.split == name} for name in ("train", "val", "test")}


@pytest.mark.parametrize(("subject", "sequence"), RELEASED.items())
def test_released_hold_out(subject, sequence):
    assert released_test_sequence(subject) == sequence


@pytest.mark.parametrize("name", [UNION.name, "074_EMO-1_v16_DS4_whiteBg_staticOffset_maskBelowLine", "x_074"])
def test_number_of_a_subject(name):
    assert subject_number(Path(name)) == "074"


def test_a_folder_without_a_number_has_no_released_split():
    with pytest.raises(InputError, match=r"anna_12345: capture\.split: .*name the test sequence"):
        split_frames(frames(), "released", None, Path("anna_12345"))


def test_files_rule_keeps_what_the_files_say():
    found, rule = split_frames(frames(), "files", None, UNION)
    assert list(found) == frames() and rule == "files"


@pytest.mark.parametrize(("rule", "held_out"), [("EMO-1", "EMO-1"), ("EXP-2", "EXP-2"), ("released", "EMO-4")])
def test_a_sequence_is_held_out_with_all_cameras(rule, held_out):
    found, name = split_frames(frames(MANY), rule, None, UNION)
    splits = by_split(found)
    assert splits["test"] == {(held_out, c) for c in MANY}
    assert splits["val"] == {(s, 8) for s in SEQUENCES if s != held_out}
    assert splits["train"] == {(s, c) for s in SEQUENCES if s != held_out for c in MANY if c != 8}
    assert name.startswith(rule) and held_out in name and "camera 8" in name


@pytest.mark.parametrize("rule", ["EMO-1", "released", "blocks"])
@pytest.mark.parametrize("cameras", [(0,), (0, 8), (0, 3, 8), (0, 1, 2, 3, 8)])
def test_few_cameras_all_train(rule, cameras):
    """Each camera sees the training timesteps, and the same ones; validation is at other times."""
    found, name = split_frames(frames(cameras, steps=20), rule, None, UNION)
    times = {split: {c: {f.timestep for f in found if f.split == split and f.camera == c} for c in cameras}
             for split in ("train", "val", "test")}  # fmt: skip
    for split in times.values():
        assert all(split[c] == split[cameras[0]] for c in cameras) and split[cameras[0]]
    train, val, test = (split[cameras[0]] for split in times.values())
    assert len(train | val | test) == len(train) + len(val) + len(test) == 80
    assert 0.05 <= len(val) / len(train | val) <= 0.15 and "validation by time" in name


@pytest.mark.parametrize("cameras", [(0, 1, 2, 3, 8), MANY])
def test_a_single_sequence_loses_no_camera_of_few(cameras):
    one = [replace(frame, split="") for frame in frames(cameras, steps=10)]
    splits = by_split(split_single_sequence(one))
    trained = {camera for _, camera in splits["train"]}
    assert trained == ({*cameras} if len(cameras) < ENOUGH_CAMERAS else {*cameras} - {8}) and splits["val"]


def test_blocks_are_those_of_tracked_footage():
    found, name = split_frames(frames(MANY, steps=20), "blocks", None, UNION)
    tested = {f.timestep for f in found if f.split == "test"}
    assert tested == {t for t, split in enumerate(blocks(80)) if split != "train"}
    assert name == "blocks, validation camera 8" and by_split(found)["val"] == {(s, 8) for s in SEQUENCES}


def test_validation_camera():
    found, _ = split_frames(frames((0, 3)), "EMO-1", 3, UNION)
    assert by_split(found)["val"] == {(s, 3) for s in SEQUENCES[1:]}
    found, _ = split_frames(frames(), "files", 0, UNION)
    assert by_split(found)["val"] == {(s, 0) for s in SEQUENCES[:3]}
    assert by_split(found)["test"] == {(SEQUENCES[3], c) for c in (0, 3, 8)}


def test_long_names_of_sequences_are_found_by_their_start():
    long = [Frame(0, 0, "EXP-2-eyes", "train", "", None, "", 0), Frame(1, 0, "EXP-21", "train", "", None, "", 0)]
    assert [frame.split for frame in split_frames(long, "EXP-2", None, UNION)[0]] == ["test", "train"]


@pytest.mark.parametrize(
    ("rule", "camera", "says"),
    [
        ("EXP-7", None, r"capture\.split: there is no sequence EXP-7; sequences: EMO-1, EMO-4, EXP-2, EXP-2b"),
        ("EXP-2", 5, r"capture\.validation_camera: there is no camera 5; cameras: 0, 3, 8"),
    ],
)
def test_what_is_not_there_is_named(rule, camera, says):
    with pytest.raises(InputError, match=says):
        split_frames(frames(), rule, camera, UNION)


def test_a_split_leaves_training_frames():
    one = [frame for frame in frames() if frame.sequence == "EMO-1"]
    with pytest.raises(InputError, match="no training frame is left"):
        split_frames(one, "EMO-1", None, UNION)


@given(
    stride=st.integers(1, 7),
    max_frames=st.none() | st.integers(1, 70),
    missing=st.sets(st.tuples(st.integers(0, 19), st.sampled_from([0, 3, 8])), max_size=20),
)
def test_thinning(stride, max_frames, missing):
    """Whole timesteps are left out; the first of each sequence stays unless the number is limited."""
    everything, _ = split_frames(frames(missing=missing), "EXP-2", None, UNION)
    kept = thin_frames(everything, stride, max_frames)
    assert set(kept) <= set(everything)
    for split in ("train", "val", "test"):
        whole, part = ([f for f in x if f.split == split] for x in (everything, kept))
        timesteps = {f.timestep for f in part}
        assert [f for f in whole if f.timestep in timesteps] == part
        assert bool(whole) == bool(part)
        if max_frames is None:
            for sequence in {f.sequence for f in whole}:
                own = sorted({f.timestep for f in everything if f.sequence == sequence})
                assert {f.timestep for f in part if f.sequence == sequence} <= set(own[::stride])
        else:
            assert len(part) <= max_frames or len(timesteps) == 1


def test_timesteps_are_spread_evenly():
    everything = [Frame(t, c, "", "train", "", None, "", 0) for t in range(100) for c in range(4)]
    kept = sorted({frame.timestep for frame in thin_frames(everything, max_frames=44)})
    assert len(kept) == 11 and kept[0] == 0 and kept[-1] == 99
    assert {b - a for a, b in pairwise(kept)} <= {9, 10}
