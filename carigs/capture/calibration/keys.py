"""Keys of calibrations: which ones carigs reads, refuses, warns of, or has no use for.

A camera of carigs is a pinhole without skew, and has one pose. Whatever says otherwise moves pixels.

| keys | what happens |
|---|---|
| those that the format has in carigs (`TRANSFORMS`, `CAMERAS_JSON`) | read |
| lens distortion, skew, other lenses, rolling shutter (`REFUSED`) | refused, unless the values say that there is none |
| transforms of the world, mattes by another name (`WARNED`) | left unread; warned of if their values change something |
| what viewers and other trainings need, and names (`IRRELEVANT`) | left unread |
| every other key | left unread, and warned of: it may move pixels |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Set
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from carigs.capture.calibration.pinhole_values import is_identity, is_pinhole, is_square, is_true, is_zero
from carigs.errors import InputError

TRANSFORMS = frozenset({
    "frames", "timestep_index", "camera_index", "sequence", "file_path", "fg_mask_path", "flame_param_path",
    "transform_matrix", "fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "cx", "cy", "w", "h",
})  # fmt: skip
"""Of transforms_*.json."""
CAMERAS_JSON = frozenset({"cameras", "name", "width", "height", "fx", "fy", "cx", "cy", "camera_from_world"})
"""Of cameras.json."""
IRRELEVANT = frozenset({
    # names and numbers that VHAP writes
    "timestep_indices", "camera_indices", "timestep_index_original", "timestep_id", "camera_id",
    # instant-ngp and Nerfstudio: settings of their own training and viewers, measurements, other files
    "aabb_scale", "aabb", "up", "n_frames", "sharpness", "near", "far", "white_transparent", "black_transparent",
    "from_na", "render_aabb", "integer_depth_scale", "enable_depth_loading", "enable_ray_loading", "depth_path",
    "depth_file_path", "depth_unit_scale_factor", "normal_path", "ply_file_path", "colmap_im_id", "train_filenames",
    "val_filenames", "test_filenames", "orientation_override", "auto_scale_poses_override", "indices",
})  # fmt: skip
UNDISTORT = "undistort images and mattes (cv2.undistort, or colmap image_undistorter), then write the new intrinsics"
LARGEST_NOTE = 8
"""Keys that a warning lists."""


class Rule(NamedTuple):
    """What is done about keys that carigs does not read."""

    pattern: re.Pattern[str]
    """Of the key in lower case, without underscores and dashes; a single letter keeps its case, for K is a matrix."""
    changes_nothing: Callable[[Any], bool]
    """Whether a value may be ignored."""
    problem: str
    remedy: str


REFUSED = tuple(
    Rule(re.compile(pattern), changes_nothing, problem, remedy)
    for pattern, changes_nothing, problem, remedy in (
        (
            r"(camera|lens|dist|distortion|projection)(model|type|name)",
            is_pinhole,
            "is a camera model that is no pinhole",
            UNDISTORT,
        ),
        (
            r"(k|p|s|b)\d+|k|tau[xy]|xi|ftheta.*|dist|(?!.*undist).*(distort|distcoef).*|.*(radial|tangential|affinity).*",
            lambda value: is_zero(value) or is_pinhole(value),
            "is lens distortion, which carigs has no model of",
            UNDISTORT,
        ),
        (
            r"(is|are|already|images?|frames?)*undistorted",
            is_true,
            "does not say that images are free of lens distortion, which carigs has no model of",
            UNDISTORT,
        ),
        (r"s|sk|alphac", is_zero, "is a skew of the pixels, which carigs has no model of", UNDISTORT),
        (
            r".*(skew|shear)(angle|deg|degrees|rad|radians)?",
            is_square,
            "is a skew of the pixels, which carigs has no model of",
            UNDISTORT,
        ),
        (
            r"(is)?(fisheye|equirectangular|latlong|orthographic|omnidirectional|panorama|vr180).*",
            is_zero,
            "is another lens than that of a pinhole camera",
            UNDISTORT,
        ),
        (
            r"(is)?rollingshutter.*",
            is_zero,
            "is a rolling shutter: the rows of an image have different cameras",
            "remove the motion from the images; carigs has one camera per image",
        ),
        (
            r"principalpoint",
            lambda value: value is None,
            "is a principal point that carigs does not read",
            "write cx and cy in pixels instead",
        ),
    )
)
"""The first that matches counts."""
WARNED = tuple(
    Rule(re.compile(pattern), changes_nothing, problem, remedy)
    for pattern, changes_nothing, problem, remedy in (
        (
            r"applied(transform|scale)|scale",
            is_identity,
            "is not applied: poses are taken as they are, in metres",
            "write poses in the world of the head parameters, and remove the key",
        ),
        (
            r"offset",
            is_zero,
            "is not applied: poses are taken as they are, in metres",
            "write poses in the world of the head parameters, and remove the key",
        ),
        (
            r"(.*mask|.*matte|alpha)s?(path|file|filepath)?",
            lambda value: value is None,
            "is not read as a matte",
            "name mattes by fg_mask_path, or remove the key",
        ),
    )
)


class CalibrationKeys:
    """The keys of the objects of a calibration.

    Args:
        read: The keys that the format has in carigs.
    """

    def __init__(self, read: Set[str]) -> None:
        self._known = read | IRRELEVANT
        self._notes: dict[tuple[Path, str], tuple[str, str, int]] = {}
        self._unknown: dict[Path, dict[str, str]] = {}

    def check(self, entry: Mapping[str, Any], file: Path, where: str = "") -> None:
        """Check the keys of one object.

        Args:
            entry: The object.
            file: Its file, for messages.
            where: Its position in the file, for messages.

        Raises:
            InputError: If a key says that the camera is no pinhole.
        """
        for key in sorted(entry.keys() - self._known):
            refuse_distortion(key, entry[key], file, where)
            rule = _rule(key, WARNED)
            field = f"{where}.{key}" if where else key
            if rule is None and _rule(key, REFUSED) is None:
                self._unknown.setdefault(file, {}).setdefault(key, field)
            elif rule is not None and not rule.changes_nothing(entry[key]):
                text = f"{rule.problem}; {rule.remedy}"
                first, _, count = self._notes.get((file, key), (field, text, 0))
                self._notes[file, key] = first, text, count + 1

    def warnings(self) -> tuple[str, ...]:
        """What was left unread although it may move pixels.

        Returns:
            One line per key of `WARNED` and file, and one per file with other keys.
        """
        lines = []
        for (file, _), (field, text, count) in self._notes.items():
            others = f" ({count} times)" if count > 1 else ""
            lines.append(f"{file}: {field}: {text}{others}")
        for file, fields in self._unknown.items():
            listed = ", ".join(list(fields)[:LARGEST_NOTE]) + (", ..." if len(fields) > LARGEST_NOTE else "")
            problem = f"carigs does not read {listed}; if this moves pixels or cameras, undo it, then remove the key"
            lines.append(f"{file}: {next(iter(fields.values()))}: {problem}")
        return tuple(lines)


def refuse_distortion(key: str, value: Any, file: Path, where: str = "") -> None:
    """Refuse a value that says that a camera is no pinhole.

    Args:
        key: Its key.
        value: The value.
        file: Its file, for messages.
        where: Position of its object in the file, for messages.

    Raises:
        InputError: If the key is in `REFUSED`, and the value changes pixels.
    """
    rule = _rule(key, REFUSED)
    if rule is not None and not rule.changes_nothing(value):
        shown = " ".join(str(value).split())
        shown = shown if len(shown) <= 60 else f"{shown[:57]}..."
        raise InputError(
            f"{shown} {rule.problem}", file=file, field=f"{where}.{key}" if where else key, remedy=rule.remedy
        )


@lru_cache(1024)
def _rule(key: str, rules: tuple[Rule, ...]) -> Rule | None:
    plain = key if len(key) == 1 else re.sub("[_ -]", "", key.lower())
    return next((rule for rule in rules if rule.pattern.fullmatch(plain)), None)
