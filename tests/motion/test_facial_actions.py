"""Names of expressions: the tables of ARKit, ICT-FaceKit and the procedural head name the same actions."""

import numpy as np
import pytest
from shared_data import DATA, needs_data

from carigs.head import HeadModel
from carigs.motion.facial_actions import ARKIT, ONE_PIECE, SUBSTITUTES, TWO_SIDED, actions, name_map, opposite, part
from carigs.toy.rig.head_model import head_model

NEEDED = "cheek_puff_left eye_blink_right jaw_open mouth_smile_left brow_inner_up_right".split()


def every_action():
    return ONE_PIECE | {f"{name}_{side}" for name in TWO_SIDED for side in ("left", "right")}


def test_arkit_has_52_names_that_are_all_actions():
    assert len(set(ARKIT)) == 52
    named = [actions(name) for name in ARKIT]
    assert all(named) and frozenset().union(*named) == every_action()
    assert sum(map(len, named)) == len(every_action())  # no action has two names


@pytest.mark.parametrize("spelling", ["eyeBlinkLeft", "EyeBlinkLeft", "eyeBlink_L", "eye_blink_left", " eyeBlink_l "])
def test_spellings_of_a_name(spelling):
    assert actions(spelling) == {"eye_blink_left"} and part(spelling) == "eyes"


def test_a_direction_is_no_side():
    assert actions("jawLeft") == {"jaw_left"} and actions("mouth_right") == {"mouth_right"}
    assert actions("smile") == {"mouth_smile_left", "mouth_smile_right"}
    assert actions("whatever") == actions("") == actions("left") == frozenset() and part("whatever") == ""


def test_mirroring_an_action_twice_is_the_identity():
    for action in every_action():
        assert opposite(opposite(action)) == action
        assert (opposite(action) == action) == ("left" not in action and "right" not in action)


def sides(model: HeadModel) -> None:
    """Left expressions move the left half of the face, +x."""
    for place, name in enumerate(model.expression_names):
        moved = np.linalg.norm(model.expression_basis[:, :, place], axis=1)
        middle = (moved @ model.v_template[:, 0]) / moved.sum()
        for action in actions(name):
            if len(actions(name)) == 1 and action.rpartition("_")[0] in TWO_SIDED:
                assert (middle > 0) == action.endswith("left"), name


def signs(model: HeadModel) -> None:
    """Jaw and brows move where their names say."""
    names = list(model.expression_names)
    basis = {
        next(iter(actions(name))): model.expression_basis[:, :, names.index(name)] for name in names if actions(name)
    }

    def mean(action):
        moved = basis[action]
        weight = np.linalg.norm(moved, axis=1)
        return weight @ moved / weight.sum()

    assert mean("jaw_open")[1] < 0 and mean("brow_inner_up_left")[1] > 0 and mean("brow_down_right")[1] < 0
    assert mean("jaw_left")[0] > 0 > mean("jaw_right")[0] and mean("mouth_left")[0] > 0 > mean("mouth_right")[0]
    assert mean("jaw_forward")[2] > 0
    assert mean("mouth_smile_left")[1] > 0 > mean("mouth_frown_left")[1]


def test_the_procedural_head_moves_as_its_names_say():
    model = head_model()
    sides(model)
    signs(model)
    assert all(actions(name) for name in model.expression_names)


@needs_data
def test_ict_facekit_has_all_actions_but_the_tongue():
    model = HeadModel.load(DATA / "ict_model.npz")
    sides(model)
    signs(model)
    found = [actions(name) for name in model.expression_names]
    assert len(found) == 53 and all(len(one) == 1 for one in found)
    assert frozenset().union(*found) == every_action() - {"tongue_out"}


def test_names_map_values_to_all_heads_that_share_an_action():
    ict = ["browInnerUp_L", "browInnerUp_R", "jawOpen"]
    there, back = name_map(ict, ["browInnerUp", "JawOpen"]), name_map(["browInnerUp", "JawOpen"], ict)
    np.testing.assert_array_equal(there @ [0.2, 0.6, 0.5], [0.4, 0.5])
    np.testing.assert_array_equal(back @ [0.4, 0.5], [0.4, 0.4, 0.5])
    np.testing.assert_array_equal(name_map(["7", "x"], ["x", "3", "7"]), [[0, 1], [0, 0], [1, 0]])


def test_arkit_and_back_keeps_each_of_its_coefficients():
    head = head_model().expression_names
    round_trip = name_map(head, ARKIT) @ name_map(ARKIT, head)
    kept = [i for i, name in enumerate(ARKIT) if round_trip[i, i] > 0]
    for name in NEEDED:
        assert any(name in actions(ARKIT[i]) for i in kept)
    possible = frozenset().union(*map(actions, head))
    has = [i for i, name in enumerate(ARKIT) if actions(name) <= possible]
    np.testing.assert_allclose(round_trip[np.ix_(kept, has)].sum(axis=1), 1)


def test_substitutes_are_actions_and_act_only_where_an_action_is_missing():
    for action, others in SUBSTITUTES.items():
        assert {action, *others} <= every_action() and action not in others
    driver = ["mouthFunnel", "mouthPucker"]
    np.testing.assert_array_equal(name_map(driver, ["mouthPucker"]), [[1, 1]])
    np.testing.assert_array_equal(name_map(driver, ["mouthPucker", "mouth_funnel"]), [[0, 1], [1, 0]])
