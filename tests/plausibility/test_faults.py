"""Faults: what is alike is one fault, each with its places and a remedy."""

import re
from pathlib import Path

import pytest

from carigs.errors import InputError
from carigs.plausibility.faults import OTHERWISE, REMEDIES, Fault, error_faults, finding_faults, remedy
from carigs.plausibility.findings import Finding

ROOT = Path("capture")


def test_errors_that_differ_in_numbers_and_places_alone_are_one_fault():
    errors = [
        InputError(f"a focal length must be positive, found {-f}", file=ROOT / "transforms_train.json", field=f"[{i}]")
        for i, f in enumerate((1000, 12.5, 3e4))
    ]
    (fault,) = error_faults([*errors, errors[0]], ROOT)
    assert fault.problem == "a focal length must be positive, found -1000"
    assert fault.places[0] == "transforms_train.json: [0]"
    assert fault.places[1] == "transforms_train.json: [1]: a focal length must be positive, found -12.5"
    assert len(fault.places) == 3
    assert fault.remedy == "write the absolute value"


def test_the_worst_finding_comes_first():
    findings = [
        Finding("the matte is empty", ROOT / f"{i}.png", "", f"{i} %", size) for i, size in enumerate((1, 3, 2))
    ]
    (fault,) = finding_faults(findings, ROOT)
    assert fault.places == ("1.png: 1 %", "2.png: 2 %", "0.png: 0 %")


def test_the_advice_of_a_message_comes_first():
    error = InputError("the matte is upside down; remedy: turn it over", file=ROOT, field="fg_mask_path")
    assert error_faults([error], ROOT) == [Fault("the matte is upside down", (".: fg_mask_path",), "turn it over")]


@pytest.mark.parametrize(
    ("sizes", "says"),
    [
        ("200 x 300 pixels, its camera has 400 x 600", "multiply fl_x, fl_y, cx, cy, w, h by 0.5"),
        ("800 x 1200 pixels, its camera has 400 x 600", "by 2"),
        ("300 x 200 pixels, its camera has 200 x 300", "write the size of the images as w and h"),
    ],
)
def test_another_resolution_is_recognised_by_the_ratio_of_the_sizes(sizes, says):
    assert says in remedy(sizes)


def test_every_problem_has_a_remedy():
    assert remedy("a problem that nobody has described") == OTHERWISE


def test_patterns_describe_messages_that_exist():
    """A message that is written anew must not lose its remedy."""
    package = Path(__file__).parents[2] / "carigs"
    code = " ".join(f.read_text() for f in package.rglob("*.py") if f.name != "faults.py")
    code = re.sub(r'"\s+f?"', "", code)
    for pattern in REMEDIES:
        for alternative in pattern.split("|"):
            assert re.search(alternative, code), alternative
