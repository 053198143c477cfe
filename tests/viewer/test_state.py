"""Values of the controls and their history."""

import numpy as np
import pytest
from avatars import ball_avatar
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import SettingsError
from carigs.library import HeadAvatar
from carigs.viewer.controls import Control, controls_of
from carigs.viewer.state import STEPS, State, parameters_of, region_levels, timestep_of, without_exaggeration

CONTROLS = (
    Control("level", "gamma", "exaggeration", 0.0, 0.3, 0.01),
    Control("region:nose", "nose", "regions", 0.0, 0.3, 0.01),
    Control("frame", "timestep", "time", 0, 4, 1),
)


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


@given(st.lists(st.tuples(st.sampled_from(["level", "region:nose", "frame"]), st.floats(0, 4), st.floats(0, 3))))
def test_undo_takes_everything_back_and_redo_repeats_it(moves):
    state, now = State(CONTROLS), 0.0
    start = dict(state.values)
    for name, value, pause in moves:
        now += pause
        state.set(name, value, now)
    end = dict(state.values)
    while state.undo():
        pass
    assert state.values == start
    while state.redo():
        pass
    assert state.values == end


def test_a_drag_is_one_step_and_a_new_change_forgets_what_was_undone():
    state = State(CONTROLS)
    for i in range(20):
        state.set("level", 0.01 * i, 0.05 * i)
    state.set("region:nose", 0.1, 1.0)
    state.undo()
    assert state.values["level"] == pytest.approx(0.19) and state.values["region:nose"] == 0
    state.undo()
    assert state.values["level"] == 0 and not state.undo()
    state.set("frame", 2, 9.0)
    assert not state.redo()
    state.reset()
    assert state.values["frame"] == 2  # the timestep is no exaggeration
    state.set("level", 0.2, 20.0)
    state.reset()
    assert state.values["level"] == 0 and state.undo() and state.values["level"] == 0.2


def test_the_history_is_bounded():
    state = State(CONTROLS)
    for i in range(3 * STEPS):
        state.set("level", 0.1 + 0.1 * (i % 2), 10.0 * i)
    steps = 0
    while state.undo():
        steps += 1
    assert steps == STEPS


def test_values_stay_in_range_and_hostile_ones_are_refused():
    state = State(CONTROLS)
    state.set("level", 7, 0.0)
    assert state.values["level"] == 0.3
    state.set("frame", 2.4, 0.0)
    assert state.values["frame"] == 2
    for value in (float("nan"), float("inf"), "0.1", None, [0.1]):
        with pytest.raises(SettingsError, match="level"):
            state.set("level", value, 0.0)
    with pytest.raises(SettingsError, match="no control"):
        state.set("__class__", 0.1, 0.0)


def test_playing_goes_around_and_is_no_step_of_undo():
    state = State(CONTROLS)
    for frame in range(12):
        state.play(frame)
    assert state.values["frame"] == 11 % 5 and not state.undo()


def test_the_sliders_are_added_to_the_captured_frame(avatar):
    state = State(controls_of(avatar))
    for name, value in {"frame": 2, "expression:0": 0.3, "expression:1": -1.0, "jaw:x": 10, "eyes:y": -20}.items():
        state.set(name, value, 0.0)
    captured, found = avatar.avatar.sequence.parameters[2], parameters_of(avatar, state.values)
    np.testing.assert_allclose(found.expression[:3], captured.expression[:3] + np.array([0.3, -1.0, 0.0]))
    turned = captured.joints.copy()
    turned[avatar.joints.index("jaw"), 0] += np.radians(10)
    turned[[avatar.joints.index("left_eye"), avatar.joints.index("right_eye")], 1] -= np.radians(20)
    np.testing.assert_allclose(found.joints, turned)
    assert timestep_of(avatar, state.values) == 2
    assert captured.expression[1] == 0  # the avatar's own are as before


def test_levels_by_region(avatar):
    state = State(controls_of(avatar))
    state.set("level", 0.2, 0.0)
    state.set("region:scalp", 0.1, 0.0)
    assert region_levels(state.values) == {"scalp": 0.1}
    natural = without_exaggeration(state.values)
    assert natural["level"] == 0 and region_levels(natural) == {}
    assert state.controls["level"].high == pytest.approx(1.5 * avatar.gamma)
