"""Combinations of a sweep, and the names of their folders."""

import re
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.config import read_sweep, split_sweep, study_table
from carigs.config.names import MAX_NAME_BYTES
from carigs.config.sweep import MAX_FOLDER_BYTES, combination_folder, value_text
from carigs.errors import SettingsError

# Values that are easily taken for each other.
SCALARS = st.one_of(
    st.sampled_from([None, True, False, 0, 1, 0.1, 1e-05, 1e20]),
    st.sampled_from(
        ["", "null", "true", "True", "1", "1.0", "0.1", "1e-05", "nan", "a", "A", "a.", ".a", "a=1,b", "+"]
    ),
    st.integers(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
)
VALUES = SCALARS | st.lists(SCALARS, max_size=3) | st.dictionaries(st.sampled_from("ab"), SCALARS, max_size=2)
KEYS = st.sampled_from(
    ["train.iterations", "capture.toy.seed", "study.variants", "exaggerate", "capture.toy.supersampling"]
)
POINTS = st.dictionaries(KEYS, VALUES, min_size=1, max_size=3)


def typed(value):
    """A value with its types: equal numbers are the same, a number is no boolean and no text."""
    if isinstance(value, dict):
        return {key: typed(element) for key, element in value.items()}
    if isinstance(value, list):
        return [typed(element) for element in value]
    return ("number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value), value)


def folder(point, study="toy"):
    return combination_folder(study, {key: value_text(value) for key, value in point.items()})


@given(first=POINTS, second=POINTS)
def test_different_values_have_different_folders_and_equal_ones_the_same(first, second):
    assert (folder(first) == folder(second)) == (typed(first) == typed(second))


@given(first=VALUES, second=VALUES)
def test_one_different_value_is_a_different_folder(first, second):
    point = {"train.iterations": 20}
    same = folder({**point, "train.start": first}) == folder({**point, "train.start": second})
    assert same == (typed(first) == typed(second))


@given(point=POINTS, study=st.from_regex(r"\A\w[\w.-]*\Z").filter(lambda name: len(name.encode()) <= MAX_NAME_BYTES))
def test_folders_are_legal_on_every_file_system_and_no_study_of_a_user_has_their_names(point, study):
    name = folder(point, study)
    assert len(name.encode()) <= MAX_FOLDER_BYTES
    assert name.startswith(f"{study}+")
    assert re.fullmatch(r"[a-z0-9_.,=+-]+", name.removeprefix(study)) and not name.endswith(".")


def test_a_folder_tells_its_values_whatever_their_order_and_form():
    names = set()
    for swept in (
        ["train.iterations=20", "capture.toy.seed=1,2"],
        ["train.iterations=20,20", "capture.toy.seed=range(1,3)"],
        ["capture.toy.seed=2,1", "gamma=0.1,0.2", "train.iterations=choice(20)"],
    ):
        names.add(frozenset(combination.study for combination in read_sweep([], swept).combinations))
    assert names == {frozenset(f"toy+capture.toy.seed={seed},train.iterations=20" for seed in (1, 2))}


def test_combinations_of_different_gammas_share_a_folder():
    sweep = read_sweep(["study.levels=[]"], ["gamma=0.10,0.2", "capture.toy.seed=3,4"])
    table = study_table(["study.levels=[]"], sweep)
    assert table == {
        f"toy+capture.toy.seed={seed}": [
            ("study.levels=[]", f"gamma={gamma}", f"capture.toy.seed={seed}") for gamma in (0.1, 0.2)
        ]
        for seed in (3, 4)
    }
    assert (sweep.study, sweep.keys, sweep.name) == ("toy", ("gamma", "capture.toy.seed"), "gamma,capture.toy.seed")
    assert {*study_table([], read_sweep([], ["gamma=0.1,0.2"]))} == {"toy"}
    assert study_table(["gamma=0.1"], None) == {"toy": [("gamma=0.1",)]}


def test_a_sweep_has_every_combination_once_and_its_last_key_changes_fastest():
    sweep = read_sweep(["study=ict"], ["gamma=0.1,0.2,0.10", "capture.toy.seed=range(3)"])
    assert [combination.values for combination in sweep.combinations] == [*product(("0.1", "0.2"), "012")]
    assert all(combination.overrides[0] == "study=ict" for combination in sweep.combinations)


def test_of_two_overrides_for_one_key_the_later_wins():
    sweep = read_sweep([], ["capture.toy.seed=1,2", "capture.toy.seed=3,4"])
    assert [combination.values for combination in sweep.combinations] == [("3",), ("4",)]


def test_the_study_can_be_swept_over():
    sweep = read_sweep([], ["study=toy,ict"])
    assert [combination.study for combination in sweep.combinations] == ["toy+study=toy", "ict+study=ict"]


def test_overrides_with_several_values_are_told_from_lists():
    overrides = ["study.variants=[surfhead,no_mask]", "gamma=0.1,0.2", "capture.toy.seed=range(2)", "study=ict"]
    assert split_sweep(overrides) == ([overrides[0], overrides[3]], overrides[1:3])


@pytest.mark.parametrize(
    ("swept", "named"),
    [
        (["capture.toy.seed=range(1000000000000)"], "at most 10000 combinations"),
        (["capture.toy.seed=range(1000)", "gamma=range(0.1,0.2,0.001)"], "at most 10000 combinations"),
        (["gamma=["], "gamma=["),
        (["gamma=interval(0,1)"], "list the values, or use range"),
        (["gamma=glob(*)"], "list the values, or use range"),
        (["capture.toy.seed=range(3,3)"], "no value"),
        (["subject=a,b"], "study.subjects"),
        (["+train.sed=1,2"], "neither added nor removed"),
        (["train.sed=1,2"], "train.sed"),
        ([], "no key has several values"),
    ],
)
def test_a_sweep_that_cannot_be_made_is_one_line(swept, named):
    with pytest.raises(SettingsError, match=re.escape(named)) as raised:
        read_sweep([], swept)
    assert "\n" not in str(raised.value)
