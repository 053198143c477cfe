"""Parts of a head that no camera sees are named, and the directions from which it is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from carigs.capture import Camera, Capture, Frame, look_at
from carigs.head import HeadParameters
from carigs.plausibility.coverage import Coverage, capture_coverage, head_parts, lost_camera
from carigs.toy.rig.head_model import head_model

SIZE = 160


@pytest.fixture(scope="module")
def model():
    return head_model()


def seen_from(folder, model, directions, turn=(0.0, 0.0, 0.0)) -> Capture:
    """A capture with a camera 1 m away in each direction: degrees to the person's left, and up; no images."""
    model.save(folder / "head_model.npz")
    HeadParameters(rotation=np.array(turn)).save(folder / "0.npz", model)
    cameras = []
    for left, up in np.radians(directions):
        away = np.array([np.cos(up) * np.sin(left), np.sin(up), np.cos(up) * np.cos(left)])
        cameras.append(Camera(look_at(away, np.zeros(3)), 350, 350, SIZE / 2, SIZE / 2, SIZE, SIZE))
    frames = tuple(Frame(0, c, "", "train", "", None, "0.npz", c) for c in range(len(cameras)))
    return Capture(folder, folder / "head_model.npz", frames, tuple(cameras), 1.0)


def test_all_around_every_part_is_seen(model, tmp_path):
    around = [(left, up) for left in range(0, 360, 45) for up in (-35, 5, 45)]
    found = capture_coverage(seen_from(tmp_path, model, around))
    assert found.azimuth is None and found.unseen == found.partly == ()
    assert str(found).startswith("24 cameras see the head from all around, 3") and "every part is seen" in str(found)


def test_from_one_side_the_other_is_not_seen(model, tmp_path):
    left, right = (capture_coverage(seen_from(tmp_path, model, [(side * 80, 0)])) for side in (1, -1))
    assert {"the right ear", "the right side of the head"} <= set(left.unseen) and "the left ear" not in left.unseen
    swapped = {name.replace("left", "LEFT").replace("right", "left").replace("LEFT", "right") for name in left.unseen}
    assert swapped == set(right.unseen)
    assert left.azimuth == pytest.approx((80, 80), abs=5)


def test_from_the_front_the_back_is_not_seen_and_from_the_back_the_face(model, tmp_path):
    front = capture_coverage(seen_from(tmp_path, model, [(0, 0)]))
    back = capture_coverage(seen_from(tmp_path, model, [(170, 0), (-165, 10)]))
    assert {"the back of the head", "the nape"} <= set(front.unseen) and "the face" not in front.unseen
    assert {"the face", "the eyelids"} <= set(back.unseen) and "the back of the head" not in back.unseen
    assert "around the back" in str(back) and back.azimuth[1] > 180


def test_a_camera_and_a_head_that_turn_together_see_the_same(model, tmp_path):
    still = capture_coverage(seen_from(tmp_path, model, [(40, 0), (-20, 0)]))
    turned = capture_coverage(seen_from(tmp_path, model, [(70, 0), (10, 0)], turn=(0, np.radians(30), 0)))
    np.testing.assert_allclose(turned.azimuth, still.azimuth, atol=6)  # the head turns about its root, not its middle
    assert turned.unseen == still.unseen


def test_frames_that_are_held_out_show_nothing(model, tmp_path):
    capture = seen_from(tmp_path, model, [(0, 0), (180, 0)])
    kept = replace(capture, frames=(capture.frames[0], replace(capture.frames[1], split="test")))
    alone = replace(capture, frames=capture.frames[:1])
    assert capture_coverage(kept) == capture_coverage(alone)
    assert capture_coverage(replace(capture, frames=(replace(capture.frames[0], split="val"),))) is None


def test_parts_lie_where_their_names_say(model):
    vertices = model.v_template.astype(float)
    parts = head_parts(model, vertices)
    assert all(part.any() for part in parts.values())
    middle = {name: vertices[model.faces[part]].mean(axis=(0, 1)) for name, part in parts.items()}
    assert middle["the left ear"][0] > 0.05 and middle["the right ear"][0] < -0.05
    assert middle["the top of the head"][1] > middle["the face"][1] > middle["the skin under the chin"][1]
    assert middle["the back of the head"][2] < middle["the left ear"][2] < middle["the eyelids"][2]
    assert middle["the nape"][1] < middle["the back of the head"][1] and middle["the nape"][2] < 0


@pytest.mark.parametrize(
    ("azimuth", "elevation", "says"),
    [
        ((-65.0, 70.0), (10.0, 25.0), "3 cameras see the head from 70 degrees left to 65 degrees right, 10 to 25"),
        ((20.0, 70.0), (-5.0, 25.0), "from 20 to 70 degrees left, 5 degrees below to 25 degrees above"),
        ((-70.0, -20.0), (-25.0, -5.0), "from 20 to 70 degrees right, 5 to 25 degrees below"),
        ((0.2, 0.3), (0.0, 0.0), "from the front, at its own height: "),
        ((170.0, 195.0), (0.0, 0.0), "from 170 degrees left around the back to 165 degrees right"),
    ],
)  # fmt: skip
def test_directions_in_words(azimuth, elevation, says):
    found = Coverage(3, azimuth, elevation, ("the nape", "the left ear"), ("the face",))
    assert says in str(found)
    assert str(found).endswith(": nothing sees the nape and the left ear; little is seen of the face")


@pytest.mark.parametrize(("count", "rule", "named"), [(3, "files", True), (3, "EXP-2", False), (6, "files", False)])
def test_a_camera_of_few_that_only_validates_is_named(model, tmp_path, count, rule, named):
    capture = seen_from(tmp_path, model, [(10 * c, 0) for c in range(count)])
    frames = (replace(capture.frames[0], split="val"), *capture.frames[1:])
    found = lost_camera(replace(capture, frames=frames, split_rule=rule))
    assert (found is not None) == named
    if found:
        assert found.field == "camera 0" and "one of 3 cameras" in found.kind and "capture.split=blocks" in found.remedy
    by_time = (*capture.frames, *(replace(f, timestep=1, split="val") for f in capture.frames))
    assert lost_camera(replace(capture, frames=by_time)) is None
