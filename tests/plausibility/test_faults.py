"""Faults: what is alike is one fault, each with its places and a remedy."""

from pathlib import Path

import numpy as np
import pytest

from carigs.capture import Camera
from carigs.capture.image_checks import other_size
from carigs.errors import InputError, collecting
from carigs.plausibility.faults import OTHERWISE, Fault, error_faults, finding_faults
from carigs.plausibility.findings import Finding, summarize
from carigs.readers.images import ImageHeader

ROOT = Path("capture")


def test_errors_that_differ_in_numbers_and_places_alone_are_one_fault():
    errors = [
        InputError(
            f"a focal length must be positive, found {-f}",
            file=ROOT / "transforms_train.json",
            field=f"[{i}]",
            remedy="write the absolute value",
        )
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
        Finding("the matte is empty", ROOT / f"{i}.png", "", f"{i} %", "paint it", size)
        for i, size in enumerate((1, 3, 2))
    ]
    (fault,) = finding_faults(findings, ROOT)
    assert fault.places == ("1.png: 1 %", "2.png: 2 %", "0.png: 0 %")


def test_the_remedy_of_a_fault_is_that_of_its_finding_whatever_the_text_says():
    """The texts hold words that belong to other faults, and those of each other."""
    kinds = ("frames have no matte: what differs from the background", "differs from another's neutral head")
    findings = [Finding(kind, ROOT, "", "moves vertices", f"remedy {i}") for i, kind in enumerate(kinds)]
    assert [fault.remedy for fault in finding_faults(findings, ROOT)] == ["remedy 0", "remedy 1"]
    assert all(line.endswith(f"; remedy: remedy {i}") for i, line in enumerate(summarize(findings)))


def test_an_error_has_the_remedy_of_its_raiser_or_else_of_the_door():
    errors: list[InputError] = []
    for own in ("", "turn it over"):
        with collecting(errors, "export it again"):
            raise InputError(f"damaged{own and ', upside down'}", file=ROOT, field="fg_mask_path", remedy=own)
    errors.append(InputError("a problem that nobody has described", file=ROOT))
    assert [fault.remedy for fault in error_faults(errors, ROOT)] == ["export it again", "turn it over", OTHERWISE]
    assert str(errors[1]) == "capture: fg_mask_path: damaged, upside down; remedy: turn it over"
    assert error_faults(errors[1:2], ROOT) == [
        Fault("damaged, upside down", (".: fg_mask_path",), "turn it over"),
    ]


@pytest.mark.parametrize(
    ("size", "camera_size", "says"),
    [
        ((200, 300), (400, 600), "multiply fl_x, fl_y, cx, cy, w, h by 0.5"),
        ((800, 1200), (400, 600), "by 2"),
        ((300, 200), (200, 300), "write the size of the images as w and h"),
    ],
)
def test_another_resolution_is_recognised_by_the_ratio_of_the_sizes(size, camera_size, says):
    camera = Camera(np.eye(4), 500, 500, 100, 100, *camera_size)
    assert says in other_size(ImageHeader(*size), camera, ROOT / "a.png").remedy
