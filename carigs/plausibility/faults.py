"""Faults of a capture: errors and findings of one kind, with where they are and how they are mended."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.plausibility.findings import Finding

REMEDY = "; remedy: "
"""Stands before the advice in messages that give one."""
REMEDIES = {
    r"set capture.cy": "look at --sheet, then set capture.cy",
    r"no such dataset folder": "name the folder that holds transforms_train.json",
    r"this key is missing": "add the key to the entry, or remove the entry",
    r"this array is missing": "write the array; shapes are in docs/captures.md",
    r"split is empty|there is no sequence": "list frames in that file, or choose another split (--split)",
    r"no such ": "restore the file, or remove its frames from transforms_*.json",
    r"not a readable|cut off|damaged|not a PNG or JPEG|its header claims": "export it again, or remove its frames",
    r"determinant -1": "negate the column of the axis that points the wrong way: axes are x right, y up, z backward",
    r"the last row is": "write 0 0 0 1 as the last row; a matrix whose last row holds a position is transposed",
    r"is no rotation": "write columns of length 1; a scale belongs into the positions",
    r"the camera is .* m from the origin": "divide the positions by 1000 if they are in millimetres",
    r"a focal length must be positive": "write the absolute value",
    r"focal lengths are in pixels": "write pixels: w / (2 tan(fov_x / 2)), or multiply a share of the width by w",
    r"shares of the image's size": "multiply cx by w and cy by h",
    r"principal point .* lies outside": "cx and cy are pixels of images of the size w x h: scale them to that size",
    r"appear twice|is the image of two|has two parameter|are the same camera|two sequences": "remove one entry",
    r"stands elsewhere": "give the frame the transform_matrix of its camera's other frames",
    r"no path inside": "name files relative to the folder; link folders that lie elsewhere",
    r"rotations are in radians": "multiply by pi / 180 if the rotations are in degrees",
    r"metres are expected|lengths are in metres": "divide by 1000 if the lengths are in millimetres",
    r"differs from ": "write the values of one neutral head into the files of all timesteps",
    r"moves vertices": "compare the coefficients with the head model's: another model, or another unit",
    r"turns farther": "compare with the neighbouring timesteps; track this one again",
    r"skinning weight|sums to": "export the head model again: every row of weights and of J_regressor sums to 1",
    r"the faces point inwards": "reverse the order of each face's corners",
    r"behind every camera": "compare the unit and the origin of the translations with those of the cameras",
    r"tiny in the image|never sees the head": "compare the camera's unit, axes and focal length with the others'",
    r"frames have no matte": "export mattes and name them by fg_mask_path",
    r"the matte is empty|the matte is foreground where": "write opacities from 0 (background) to 255 (foreground)",
    r"does not show the stated background": "state the background of the images (--background, capture.background)",
    r"shows more than the background": "composite the images on the background with their mattes",
    r"the image has one colour|holds the same pixels": "export the image again, or remove the frame",
    r"the matte of another timestep": "give the frames the mattes of their images",
    r"outside the matte": "compare the tracking and the intrinsics of these frames with the others'",
    r"another timestep's head parameters": "give the timestep the parameters of its images",
    r"does not fit its place": "give the file the name of the place that it fits",
    r"does not fit the posed mesh": "track this timestep again, or remove the frame",
    r"camera does not agree": "compare its transform_matrix and intrinsics with those of the other cameras",
    r"cameras do not agree": "compare the intrinsics of all cameras with the calibration",
}
"""What to do, by a pattern of the message; the first that matches counts."""
OTHERWISE = "mend the field, or remove its frames from transforms_*.json"
SIZES = re.compile(r"(\d+) x (\d+) pixels, its camera has (\d+) x (\d+)")


class Fault(NamedTuple):
    """What is wrong, and everywhere it is wrong."""

    problem: str
    places: tuple[str, ...]
    """Files and fields, the worst first, with their own numbers where these differ."""
    remedy: str


def error_faults(errors: Iterable[InputError], folder: Path) -> list[Fault]:
    """Group errors by their messages, numbers aside.

    Args:
        errors: The errors.
        folder: Paths are shortened to those in it.

    Returns:
        Faults in the order of their first errors.
    """
    kinds: dict[str, list[InputError]] = {}
    for error in errors:
        kinds.setdefault(re.sub(r"[-+]?\d[\d.e+-]*|'[^']*'|\S*[/\\]\S*", "#", error.problem), []).append(error)
    faults = []
    for members in kinds.values():
        places = []
        for error in members:
            own = "" if error.problem == members[0].problem else error.problem
            places.append(_place(Path(error.file), error.field or "", own, folder))
        problem = members[0].problem
        faults.append(Fault(problem.partition(REMEDY)[0], tuple(dict.fromkeys(places)), remedy(problem)))
    return faults


def finding_faults(findings: Sequence[Finding], folder: Path) -> list[Fault]:
    """Group findings by their kind.

    Args:
        findings: The findings.
        folder: Paths are shortened to those in it.

    Returns:
        Faults in the order of their first findings.
    """
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault(finding.kind, []).append(finding)
    faults = []
    for kind, members in kinds.items():
        worst = sorted(members, key=lambda finding: -finding.size)
        places = tuple(_place(f.file, f.field, f.details.partition(REMEDY)[0], folder) for f in worst)
        faults.append(Fault(kind, places, remedy(f"{kind}: {worst[0].details}")))
    return faults


def remedy(problem: str) -> str:
    """What to do about a problem.

    Args:
        problem: The message of an error or a finding.

    Returns:
        The advice: that of the message, if it gives one.
    """
    own = problem.partition(REMEDY)[2]
    if own:
        return own
    sizes = SIZES.search(problem)
    if sizes:
        width, height, stated_width, stated_height = map(int, sizes.groups())
        x, y = width / max(stated_width, 1), height / max(stated_height, 1)
        if abs(x - y) < 0.01 * x:
            return (
                f"the intrinsics belong to images of another resolution: multiply fl_x, fl_y, cx, cy, w, h by {x:.4g}"
            )
        return "write the size of the images as w and h, and the intrinsics that belong to it"
    return next((advice for pattern, advice in REMEDIES.items() if re.search(pattern, problem)), OTHERWISE)


def _place(file: Path, field: str, details: str, folder: Path) -> str:
    name = "." if file == folder else str(file.relative_to(folder) if file.is_relative_to(folder) else file)
    where = f"{name}: {field}" if field else name
    return f"{where}: {details}" if details else where
