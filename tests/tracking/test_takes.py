"""Which frames are tracked: cuts divide a recording, and what interrupts a shot does not."""

from dataclasses import replace

import numpy as np
import pytest
from tracking.shots import WIDTH, recording

from carigs.errors import InputError
from carigs.tracking.takes import kept_frames

COUNT = 40
ALL = [*range(COUNT)]


def without(*missing):
    presence = np.ones(COUNT)
    presence[list(missing)] = 0
    return presence


def rooms(cut_at):
    return np.arange(COUNT) >= cut_at


def test_frames_without_a_face_and_those_of_the_shorter_shot_are_left_out():
    kept, [reasons] = kept_frames([recording(without(3, 20), cuts=[15], rooms=rooms(15))])
    assert kept.tolist() == [i for i in range(15, COUNT) if i != 20]
    assert [i for i, reason in enumerate(reasons) if reason] == sorted([*range(15), 20])
    assert reasons[3] == reasons[20] == "no face" and "another shot" in reasons[0]


def test_a_hand_before_the_face_interrupts_a_shot_and_does_not_end_it():
    hidden = range(12, 20)
    kept, _ = kept_frames([recording(without(*hidden), cuts=[12, 20])])
    assert kept.tolist() == [i for i in ALL if i not in hidden]


def test_a_shot_that_is_shown_again_after_another_one_is_one_shot():
    shown = np.isin(np.arange(COUNT), range(10, 28))
    kept, [reasons] = kept_frames([recording(np.ones(COUNT), cuts=[10, 28], rooms=shown, people=shown)])
    assert kept.tolist() == [i for i in ALL if not shown[i]]  # 22 frames in two takes, against 18 in one
    assert {reasons[i] for i in range(10, 28)} == {"another shot, or another face"}


def test_another_person_in_the_same_place_is_another_shot():
    kept, _ = kept_frames([recording(np.ones(COUNT), jumped=[30], people=np.arange(COUNT) >= 30)])
    assert kept.tolist() == [*range(30)]


def test_the_same_person_in_another_place_is_another_shot():
    kept, _ = kept_frames([recording(np.ones(COUNT), jumped=[30], rooms=rooms(30))])
    assert kept.tolist() == [*range(30)]


def test_a_jump_within_a_shot_stays_in_it():
    assert kept_frames([recording(np.ones(COUNT), jumped=[30])])[0].tolist() == ALL


def test_what_changes_near_the_head_does_not_end_a_shot_but_a_shift_of_the_room_does():
    y, x = np.mgrid[:64, :64]
    room = np.stack([128 + 100 * np.sin(0.5 * x + c) * np.cos(0.4 * y) for c in range(3)], axis=-1)
    near, shifted = room.copy(), np.roll(room, 2, axis=1)
    near[20:, 24:40] = 0
    for after, expected in ((near, ALL), (shifted, [*range(30)]), (0.6 * room, ALL)):
        images = np.where(np.arange(COUNT)[:, None, None, None] < 30, room, after).astype(np.uint8)
        found = recording(np.ones(COUNT), cuts=[30])
        found = found._replace(measures=found.measures._replace(thumbnails=images))
        assert kept_frames([found])[0].tolist() == expected


def test_a_grey_wall_that_is_seen_again_and_again_for_a_moment_is_one_shot():
    """Of two or three frames at a time, with the noise of a camera; in between another room is shown."""
    random = np.random.default_rng(0)
    turn = np.arange(COUNT) % 5
    wall = 128.5 + random.normal(0, 0.4, (COUNT, 64, 64, 3))
    room = random.integers(0, 256, (64, 64, 3))
    images = np.where((turn < 3)[:, None, None, None], wall, room).round().astype(np.uint8)
    found = recording(np.ones(COUNT), cuts=[i for i in ALL if turn[i] in (0, 3) and i])
    found = found._replace(measures=found.measures._replace(thumbnails=images))
    assert kept_frames([found])[0].tolist() == [i for i in ALL if turn[i] < 3]


def test_a_face_that_fills_the_image_leaves_its_edges_to_compare():
    """Turned to one side after an interruption, before the same wall and before another one."""
    grey, blue = (np.tile(colour, (64, 64, 1)) for colour in ((120, 125, 130), (60, 120, 240)))
    grey[:, :3, 0], blue[:, :3, 0] = 60, 60
    turned = grey.copy()
    turned[:, 8:56] = 20
    for after, expected in ((turned, ALL), (blue, [*range(30)])):
        images = np.where(np.arange(COUNT)[:, None, None, None] < 30, grey, after).astype(np.uint8)
        found = recording(np.ones(COUNT), cuts=[30])
        faces = replace(found.faces, boxes=np.tile(np.float32([100, 30, 540, 450]), (COUNT, 1)))
        found = found._replace(faces=faces, measures=found.measures._replace(thumbnails=images))
        assert kept_frames([found])[0].tolist() == expected


def test_a_face_that_leaves_the_image_is_left_out_from_where_half_of_it_is_outside():
    # The face is 100 pixels wide, its middle at half the width.
    shift = np.linspace(0, WIDTH / 2 + 40, COUNT)
    kept, [reasons] = kept_frames([recording(np.ones(COUNT), shift=shift)])
    assert kept.tolist() == [i for i in ALL if shift[i] < WIDTH / 2]
    assert reasons[-1] == "less than half of the face in the image"


def test_a_face_that_one_of_three_cameras_loses_stays_in_the_shot():
    cameras = [recording(np.ones(COUNT)), recording(without(*range(10, 20)), jumped=[20]), recording(np.ones(COUNT))]
    kept, reasons = kept_frames(cameras)
    assert kept.tolist() == ALL
    assert [i for i, reason in enumerate(reasons[1]) if reason] == [*range(10, 20)] and not any(reasons[0])


@pytest.mark.parametrize("shown", [0, 9])
def test_too_few_frames_with_a_face_are_an_error_that_names_the_video_and_the_frames(shown):
    said = rf"me\.mp4.* {shown} of 40 frames show one face in one shot; .* \(no face: {shown}-39\)"
    with pytest.raises(InputError, match=said):
        kept_frames([recording(without(*range(shown, COUNT)))])


def test_short_shots_are_an_error_that_names_the_frames_of_the_others():
    numbers = np.arange(COUNT) // 5
    with pytest.raises(InputError, match=r"5 of 40 .* \(another shot, or another face: 5-39\)"):
        kept_frames([recording(np.ones(COUNT), jumped=range(5, COUNT, 5), rooms=numbers, people=numbers)])
