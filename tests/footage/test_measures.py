"""Measures of frames, and the cuts and repeated frames that they show."""

import cv2
import numpy as np
import pytest

from carigs.footage import TimedFrame
from carigs.footage.cuts import find_cuts, frozen_stretches, repeated_frames
from carigs.footage.measures import measure_frames


def room(seed):
    image = np.random.default_rng(seed).integers(0, 256, (12, 16, 3), np.uint8)
    return cv2.resize(image, (160, 120), interpolation=cv2.INTER_LINEAR)


def talking(count, seed=1, speed=3, noise=2):
    """A head that moves to and fro before a still room, seen by a camera with noise."""
    rng, images = np.random.default_rng(7), []
    for number in range(count):
        image = room(seed).astype(np.float64)
        x = 80 + round(30 * np.sin(speed * number / 30))
        cv2.ellipse(image, (x, 60), (25, 35), 0, 0, 360, (200, 150, 120), -1)
        images.append((image + rng.normal(0, noise, image.shape)).clip(0, 255).astype(np.uint8))
    return images


def measured(images):
    return measure_frames(TimedFrame(i, i / 25, image) for i, image in enumerate(images))


@pytest.mark.parametrize("speed", [1, 3, 9])
def test_a_talking_head_has_no_cuts_and_no_repeated_frames(speed):
    measures = measured(talking(40, speed=speed))
    assert len(find_cuts(measures)) == 0 and not repeated_frames(measures).any()


def test_a_cut_to_another_room_and_one_within_the_room_are_found():
    images = talking(60)
    assert find_cuts(measured(images[:20] + talking(20, seed=2))).tolist() == [20]
    assert find_cuts(measured(images[:15] + images[30:45])).tolist() == [15]


@pytest.mark.parametrize("every", [3, 5, 7])
def test_cuts_that_follow_each_other_closely_are_found(every):
    rooms = talking(60, seed=1), talking(60, seed=2)
    measures = measured(rooms[number // every % 2][number] for number in range(60))
    assert find_cuts(measures).tolist() == [*range(every, 60, every)]


def test_a_camera_that_pans_has_no_cuts_also_if_frames_are_repeated():
    wide = cv2.resize(room(4), (480, 360))
    pan = [np.ascontiguousarray(wide[100:220, 6 * number : 6 * number + 160]) for number in range(50)]
    pan[:15], pan[40:] = [pan[15]] * 15, [pan[40]] * 10  # it begins and ends at once
    assert measured(pan).layout_change.max() > 0.05
    assert len(find_cuts(measured(pan))) == 0
    assert len(find_cuts(measured([image for image in pan for _ in range(2)]))) == 0


def test_a_flash_is_no_cut_but_a_change_of_exposure():
    images = [np.rint(0.5 * image).astype(np.uint8) for image in talking(30)]
    images[15:] = [2 * image for image in images[15:]]
    measures = measured(images)
    assert len(find_cuts(measures)) == 0
    assert measures.exposure[20] - measures.exposure[5] == pytest.approx(0.85, abs=0.15)  # a stop, less DARK
    assert np.abs(measures.white_balance).max() < 0.05


def test_a_change_of_white_balance_is_told_from_exposure():
    images = talking(20)
    images[10:] = [(image * [0.8, 0.9, 1.0]).astype(np.uint8) for image in images[10:]]
    change = np.diff(measured(images).white_balance[[5, 15]], axis=0)[0]
    assert change == pytest.approx([np.log2(0.8 / 0.9), np.log2(1 / 0.9)], abs=0.04)


def test_repeated_frames_and_a_frozen_picture_are_found():
    images = talking(40)
    images[7] = images[6]
    images[20:35] = [images[19]] * 15
    measures = measured(images)
    assert np.flatnonzero(repeated_frames(measures)).tolist() == [7, *range(20, 35)]
    assert frozen_stretches(measures) == [(19 / 25, 34 / 25)]


def test_blur_lowers_sharpness_in_the_face_alone():
    image = room(1)
    image[::2] = image[::2] // 2
    blurred = image.copy()
    blurred[40:80, 40:80] = cv2.blur(image[40:80, 40:80], (9, 9))

    def of_box(box):
        frames = (TimedFrame(i, i, image) for i, image in enumerate((image, blurred)))
        return measure_frames(frames, lambda frame: box).sharpness

    face, beside = of_box((42, 42, 78, 78)), of_box((90, 40, 150, 80))
    assert face[1] < 0.2 * face[0] and beside[1] == beside[0]


def test_interlaced_frames_comb():
    images = talking(24, speed=9)
    fields = [np.where(np.arange(120)[:, None, None] % 2, a, b) for a, b in zip(images[::2], images[1::2], strict=True)]
    assert np.median(measured(fields).combing) > 1 > 0.9 > np.median(measured(images).combing)
