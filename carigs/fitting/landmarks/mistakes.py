"""Usual mistakes in the unit and the origin of landmarks, and how to undo them.

The forms say which maps to pixels a mistake can give (`carigs.fitting.landmarks.image_map`). Those with one
unknown, such as images of another resolution, come before those with more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.fitting.landmarks.image_map import Form, ImageMap, MapFit, Sizes

NEAR = 0.03
"""Relative difference from a usual number up to which a fitted one is taken for it."""
RESOLUTIONS = {
    2: "twice", 1 / 2: "half", 4: "four times", 1 / 4: "a quarter of", 3: "three times", 1 / 3: "a third of",
    3 / 2: "1.5 times", 2 / 3: "two thirds of", 5 / 4: "1.25 times", 4 / 5: "0.8 times", 8: "eight times",
    1 / 8: "an eighth of",
}  # fmt: skip
SIDES = (112, 128, 160, 192, 224, 256, 299, 320, 384, 416, 448, 480, 512, 640, 768, 1024, 1280, 2048)
"""Usual sides of square images, in pixels."""

ODD_NUMBER, ODD_MAP = 0.5, 1.5
"""What speaks against a mistake if its numbers are unusual, and if the map is."""

Unknowns = Float[np.ndarray, " k"]


class Guess(NamedTuple):
    """What the free map tells of a mistake."""

    middle: Float[np.ndarray, "2"]
    """Landmark coordinates of the middle of an image."""
    scale: Float[np.ndarray, "2"]
    """Pixels per unit of the landmarks, if the head has the size of the head model."""
    size: Float[np.ndarray, "2"]
    """Width and height of an image."""


class Description(NamedTuple):
    """A mistake in words."""

    problem: str
    """What follows `the landmarks`."""
    remedy: str
    doubt: float = 0.0
    """What speaks against it, such as `ODD_NUMBER`."""


class Mistake(NamedTuple):
    """A form of maps, where to start, and the words for what was found."""

    form: Form
    start: Callable[[Guess], Unknowns]
    """NaN if the free map excludes the mistake."""
    describe: Callable[[Unknowns, Float[np.ndarray, "2"]], Description]


def guess(free: MapFit, size: Float[np.ndarray, "2"]) -> Guess:
    """Start of all forms from the fit of the free map.

    Args:
        free: The fit.
        size: Width and height of an image.

    Returns:
        The guess.
    """
    scale, offset = np.exp(free.values[:2]), free.values[2:] * size
    return Guess((size / 2 - offset) / scale, scale / free.head_size, size)


def _logarithms(values: Float[np.ndarray, " n"]) -> Unknowns:
    return np.log(np.where(values > 0, values, np.nan))


def _logarithm(values: Float[np.ndarray, " n"]) -> Unknowns:
    """Of the mean, as the one unknown; NaN if a value is not positive."""
    return np.mean(_logarithms(values), keepdims=True)


def _largest(sizes: Sizes) -> Float[np.ndarray, "t c 1 1"]:
    return sizes.max(axis=-1, keepdims=True)


def _mean(sizes: Sizes) -> Float[np.ndarray, "2"]:
    return np.asarray(sizes.mean(axis=(0, 1, 2)))


def _near(value: float, usual: float) -> bool:
    return abs(value / usual - 1) <= NEAR


def _nearest(value: float, usual: tuple[float, ...] | list[float]) -> float | None:
    """The usual number that is near, if any."""
    found = min(usual, key=lambda number: abs(np.log(value / number)))
    return found if _near(value, found) else None


def _nothing(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    return Description("", "")


def _resolution(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    scale = float(np.exp(unknowns[0]))
    for side, name in zip(size, ("width", "height"), strict=True):
        if _near(scale, side):
            return Description(f"are shares of the image's {name}", f"multiply x and y by {name[0]}")
    factor = _nearest(1 / scale, list(RESOLUTIONS))
    if factor is not None:
        problem = f"belong to images of {RESOLUTIONS[factor]} the resolution"
        return Description(problem, f"multiply x and y by {1 / factor:.4g}")
    if scale > size.max() / 4:
        problem, remedy = f"are shares of about {scale:.3g} pixels", f"multiply x and y by about {scale:.3g}"
        return Description(problem, remedy, ODD_NUMBER)
    problem = f"belong to images of about {1 / scale:.3g} times the resolution"
    return Description(problem, f"multiply x and y by about {scale:.3g}", ODD_NUMBER)


def _shares(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    scale = float(np.exp(unknowns[0]))
    if _near(scale, 1):
        return Description("are shares of the image's size", "multiply x by w and y by h")
    for whole, name in ((100, "percent"), (1000, "thousandths")):
        if _near(whole * scale, 1):
            problem = f"are {name} of the image's size"
            return Description(problem, f"multiply x by w / {whole} and y by h / {whole}")
    return _resized(np.repeat(unknowns, 2), size)


def _resized(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    fitted = np.exp(-unknowns)
    sides = [_nearest(side, list(SIDES)) for side in fitted]
    usual = None not in sides
    names = [f"{side if usual else float(f'{exact:.3g}'):g}" for side, exact in zip(sides, fitted, strict=True)]
    about = "" if usual else "about "
    problem = f"belong to images that were resized to {about}{names[0]} x {names[1]}"
    return Description(problem, f"multiply x by w / {names[0]} and y by h / {names[1]}", 0 if usual else ODD_MAP)


def _letterbox(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    scale = float(np.exp(unknowns[0]))
    side = _nearest(size.max() / scale, list(SIDES)) or max(round(size.max() / scale), 1)
    factor, border = f"{size.max() / side:.4g}", (size.max() - size) / 2
    axis = "xy"[int(np.argmax(border))]
    problem = f"belong to images that were scaled into a square of {side} pixels with borders"
    remedy = f"multiply x and y by {factor}, then subtract {border.max():.4g} from {axis}"
    return Description(problem, remedy, 0 if side in SIDES else ODD_MAP)


def _from_the_middle(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    problem = "count from the middle of the image in another unit"
    remedy = f"multiply x and y by about {np.exp(unknowns[0]):.3g}, then add w / 2 to x and h / 2 to y"
    return Description(problem, remedy, ODD_MAP)


def _shift(axis: int) -> Mistake:
    """A crop of which the shift along one axis is all that the cameras tell."""
    along, across, centre = "xy"[axis], "yx"[axis], ("cx", "cy")[axis]
    unit = np.eye(2)[axis]

    def describe(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
        pixels = float(unknowns[0] * size[axis])
        problem = f"are shifted by about {-pixels:.0f} pixels in {along}, as in a crop of the images"
        remedy = f"add {pixels:.0f} to {along} and to {across} what was cut off there, which the cameras do not tell"
        return Description(problem, f"{remedy}, or correct {centre} of all cameras")

    form = Form(lambda v, s: ImageMap(SAME, v * unit * _mean(s)), 0, 1)
    return Mistake(form, lambda g: ((g.size / 2 - g.middle) / g.size)[[axis]], describe)


def _crop(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    x, y = unknowns * size
    problem = f"are shifted by about ({-x:.0f}, {-y:.0f}) pixels, as in a crop of the images"
    return Description(problem, f"add {x:.0f} to x and {y:.0f} to y, or correct cx and cy of all cameras")


def _resized_crop(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    (x, y), scale = unknowns[1:] * size, np.exp(unknowns[0])
    problem = "belong to a crop of the images in another resolution"
    remedy = f"multiply x and y by about {scale:.3g}, then add about {x:.0f} to x and {y:.0f} to y"
    return Description(problem, remedy, ODD_MAP)


def _free(unknowns: Unknowns, size: Float[np.ndarray, "2"]) -> Description:
    (x, y), (across, down) = unknowns[2:] * size, np.exp(unknowns[:2])
    remedy = f"write about {across:.3g} x + {x:.0f} and {down:.3g} y + {y:.0f}"
    return Description("have another scale in x than in y, and another origin", remedy, ODD_MAP)


ORIGIN, SAME = np.zeros(2), np.ones(2)
NO_MISTAKE = Mistake(Form(lambda v, s: ImageMap(SAME, ORIGIN), 0), lambda g: np.zeros(0), _nothing)
FREE = Form(lambda v, s: ImageMap(np.exp(v[:2]), v[2:] * _mean(s)), 2, 2)
MISTAKES = (
    NO_MISTAKE,
    Mistake(
        Form(lambda v, s: ImageMap(SAME, s / 2), 0),
        lambda g: np.zeros(0),
        lambda v, size: Description("count from the middle of the image", "add w / 2 to x and h / 2 to y"),
    ),
    Mistake(
        Form(lambda v, s: ImageMap(s / 2, s / 2), 0),
        lambda g: np.zeros(0),
        lambda v, size: Description("run from -1 to 1 over the image", "write (x + 1) w / 2 and (y + 1) h / 2"),
    ),
    Mistake(
        Form(lambda v, s: ImageMap(s, s / 2), 0),
        lambda g: np.zeros(0),
        lambda v, size: Description("run from -1/2 to 1/2 over the image", "write (x + 1/2) w and (y + 1/2) h"),
    ),
    Mistake(Form(lambda v, s: ImageMap(np.exp(v[0]) * s, ORIGIN), 1), lambda g: _logarithm(0.5 / g.middle), _shares),
    Mistake(
        Form(lambda v, s: ImageMap(np.exp(v[0]) * SAME, ORIGIN), 1),
        lambda g: _logarithm(g.size / 2 / g.middle),
        _resolution,
    ),
    Mistake(
        Form(lambda v, s: ImageMap(np.exp(v[0]) * SAME, (s - _largest(s)) / 2), 1),
        lambda g: _logarithm(g.size.max() / 2 / g.middle),
        _letterbox,
    ),
    Mistake(
        Form(lambda v, s: ImageMap(np.exp(v[0]) * SAME, s / 2), 1), lambda g: _logarithm(g.scale), _from_the_middle
    ),
    Mistake(
        Form(lambda v, s: ImageMap(np.exp(v) * s, ORIGIN), 2),
        lambda g: _logarithms(0.5 / g.middle),
        _resized,
    ),
    _shift(0),
    _shift(1),
    Mistake(Form(lambda v, s: ImageMap(SAME, v * _mean(s)), 0, 2), lambda g: (g.size / 2 - g.middle) / g.size, _crop),
    Mistake(
        Form(lambda v, s: ImageMap(np.exp(v[0]) * SAME, v[1:] * _mean(s)), 1, 2),
        lambda g: np.append(_logarithm(g.scale), (g.size / 2 - np.mean(g.scale) * g.middle) / g.size),
        _resized_crop,
    ),
    Mistake(FREE, lambda g: np.append(np.log(g.scale), (g.size / 2 - g.scale * g.middle) / g.size), _free),
)
"""From few unknowns to many."""
