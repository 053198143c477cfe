"""Are landmarks in pixels of the images, x before y, from the upper left corner, in the order of the embedding?

A rigid mean head is fitted to the landmarks as stated, and with a map from landmarks to pixels
(`image_map`) in all orders (`orders`). If a map that a usual mistake gives (`mistakes`) leaves much smaller errors, it
is named. No shape or expression takes part: they
would bend the face to landmarks in a wrong unit. Few cameras, or cameras side by side, leave more maps possible; what
they do not tell apart is said to be so.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError
from carigs.fitting.landmarks.fit import Observations
from carigs.fitting.landmarks.image_map import Form, MapFit, OwnForm, Views, centred_pixels, fit_map, spreads
from carigs.fitting.landmarks.mistakes import FREE, MISTAKES, NO_MISTAKE, ODD_MAP, Description, guess
from carigs.fitting.landmarks.orders import Order, orders
from carigs.fitting.triangulation import LEAST_POINTS, triangulate, well_seen_timesteps

TIMESTEPS, CAMERAS = 2, 8
"""Timesteps and cameras whose landmarks are fitted."""
SUSPICIOUS = 0.1
"""Error of the mean head from which orders are tried, in sizes of the face. It is 0.03 without noise on `ict_s1` and
`ict_s7`, 0.07 with three pixels, 0.09 if a fifth are outliers, too, and 0.10 for a detector on a real person."""
FREE_BETTER = 0.85
"""Share of the errors as stated that the free map must leave for mistakes to be tried."""
BETTER, MUCH_BETTER, OWN_BETTER = 0.75, 0.5, 0.3
"""Share of the errors as stated that a map may leave to be believed; one with two scales or another order; and one with
an origin in each image, which also follows cameras that are numbered wrongly. Right landmarks leave more than 0.92 with
all maps of one scale, and 0.7 with two, as faces differ in their proportions."""
BELIEVED_HEAD, BELIEVED_RAYS = 0.13, 0.075
"""Errors of the head and of rays up to which a map is believed."""
AS_GOOD = 1.15
"""Errors, in those of the best map, up to which a map explains the landmarks as well."""
USUAL_SIZE, ODD_SIZE = 1.2, 1.0
"""Ratio of two heads' sizes that is odd, and what a head of this or another odd size speaks against a mistake: no more,
as the cameras may be in another unit."""
UNKNOWN, DIFFERENT = 0.1, 0.2
"""What each unknown speaks against a mistake, and how much more must speak against another one to exclude it."""
SAME_MAP = 0.05
"""Distance between two maps of the landmarks that are one, in sizes of the face."""
IMPOSSIBLE = 0.2
"""Error of the mean head in sizes of the face that no landmarks of a face have."""
NO_PIXELS = 2.0
"""Coordinates of a whole face up to this are shares of something."""
LARGEST_ERROR = 0.1
"""Reprojection error of a fitted head, in sizes of the face in the image: 5 mm on a head. Benchmarks of detectors
(300-W, Sagonas et al. 2013) count an image as a failure at about this error."""
LEAST_ERROR = 1.0
"""Pixels that are no failure however small the face."""


class Explanation(NamedTuple):
    """A mistake that explains the landmarks."""

    doubt: float
    """What speaks against it."""
    unknowns: int
    fit: MapFit
    form: Form | OwnForm
    order: Order
    description: Description
    pixels: Float[np.ndarray, "t c p 2"]
    """The landmarks, put right."""


def check_convention(
    template: Float[np.ndarray, "p 3"], observations: Observations, sizes: Float[np.ndarray, "t c 2"], file: str
) -> None:
    """Refuse landmarks in another unit, origin or order.

    Args:
        template: The landmarks on the head model, in metres.
        observations: The landmarks in the images.
        sizes: Width and height of the images.
        file: Where the landmarks come from, for messages.

    Raises:
        InputError: If a mistake explains the landmarks, which it names; if several do, which it lists; or if they
            cannot be pixels of a face.
    """
    largest = float(np.abs(observations.pixels[observations.confidence > 0]).max(initial=0))
    views = _chosen(observations, sizes)
    if views is not None:
        stated = fit_map(template, views, NO_MISTAKE.form, np.zeros(0), views.landmarks)
        found = _explanations(template, views, stated)
        if found:
            raise _refusal(found, stated, file)
        if stated.head_error > IMPOSSIBLE and largest > NO_PIXELS:
            problem = f"no unit, origin or order explains the landmarks: the mean head is {_words(stated)}"
            remedy = "compare their order with the embedding, timesteps and cameras with the images, and the cameras"
            raise InputError(problem, file=file, field="landmarks", remedy=f"{remedy} with the calibration")
    if 0 < largest <= NO_PIXELS:
        problem = f"the landmarks lie within {largest:.3g} of the corner of the image: they are no pixels"
        raise InputError(problem, file=file, field="landmarks", remedy="multiply x and y by what they were divided by")


def _chosen(observations: Observations, sizes: Float[np.ndarray, "t c 2"]) -> Views | None:
    """Some timesteps and cameras; None if their landmarks cannot be triangulated."""
    chosen = well_seen_timesteps(observations.confidence, TIMESTEPS)
    seen = observations.confidence[chosen] > 0
    cameras = np.flatnonzero((seen.sum(axis=-1) >= LEAST_POINTS).any(axis=0))
    if len(cameras) < 2:
        return None
    cameras = cameras[evenly_spread(range(len(cameras)), CAMERAS)]
    part = np.ix_(chosen, cameras)
    views = Views(observations.pixels[part], seen[:, cameras], observations.projections[part], sizes[part][:, :, None])
    middles = centred_pixels(views)  # so that rays of all units meet
    points, _ = triangulate(middles, views.seen.astype(np.float64), views.projections)
    known = np.isfinite(points).all(axis=-1).sum(axis=-1) >= LEAST_POINTS
    return Views(*(values[known] for values in views)) if known.any() else None


def _explanations(template: Float[np.ndarray, "p 3"], views: Views, stated: MapFit) -> list[Explanation]:
    """Mistakes that explain the landmarks much better than none, the likeliest first."""
    plain = (Order(), *_free(template, views))
    suspicious = stated.head_error > SUSPICIOUS
    explained = plain[2].error <= MUCH_BETTER * stated.error and plain[2].head_error <= SUSPICIOUS
    others = list(orders(template))[1:] if suspicious and not explained else []
    tried = [plain, *((order, *_free(template, order.undone(views))) for order in others)]
    best = min(free.error for _, _, free in tried)
    if not suspicious and best > FREE_BETTER * stated.error:
        return []
    found = [
        explanation
        for order, ordered, free in tried
        if free.error <= AS_GOOD * best
        for explanation in _usual(template, order, ordered, free)
        if _believed(explanation, stated, strict=order != Order() or _scales(explanation) > 1)
    ]
    if min((explanation.doubt for explanation in found), default=np.inf) >= ODD_MAP:
        own = () if _one_camera_is_off(template, views, stated) else _own_origins(template, views)
        found += [e for e in own if _believed(e, stated, strict=True) and e.fit.error <= OWN_BETTER * stated.error]
    least = min((explanation.fit.error for explanation in found), default=np.inf)
    return sorted((e for e in found if e.fit.error <= AS_GOOD * least), key=lambda explanation: explanation.doubt)


def _scales(explanation: Explanation) -> int:
    return explanation.form.scales if isinstance(explanation.form, Form) else 1


def _believed(explanation: Explanation, stated: MapFit, strict: bool) -> bool:
    fit, share = explanation.fit, MUCH_BETTER if strict else BETTER
    return fit.error <= share * stated.error and fit.head_error <= BELIEVED_HEAD and fit.ray_error <= BELIEVED_RAYS


def _free(template: Float[np.ndarray, "p 3"], views: Views) -> tuple[Views, MapFit]:
    """The free map; one timestep is enough for it."""
    pixels, size = centred_pixels(views), views.sizes.mean(axis=(0, 1, 2))
    middle = views.landmarks[views.seen].mean(axis=0)
    scale = np.linalg.norm(spreads(pixels, views.seen)) / np.linalg.norm(spreads(views.landmarks, views.seen))
    values = np.append(np.full(2, np.log(scale)), 0.5 - scale * middle / size)
    first = Views(*(array[:1] for array in views))
    return views, fit_map(template, first, FREE, values, pixels[:1])


def _usual(template: Float[np.ndarray, "p 3"], order: Order, views: Views, free: MapFit) -> Iterator[Explanation]:
    """Fits of all usual mistakes after that of the order."""
    size = views.sizes.mean(axis=(0, 1, 2))
    start = guess(free, size)
    for mistake in MISTAKES[1:] if order == Order() else MISTAKES:
        values = mistake.start(start)
        if not np.isfinite(values).all():
            continue
        scale, offset = mistake.form.image_map(values, views.sizes)
        fit = fit_map(template, views, mistake.form, values, scale * views.landmarks + offset)
        unit = mistake.describe(fit.values, size) if np.isfinite(fit.error) else Description("", "")
        doubt = _odd_size(fit) + unit.doubt + UNKNOWN * len(values)
        description = _together(order, unit)
        yield Explanation(doubt, len(values), fit, mistake.form, order, description, _pixels(fit, views))


def _together(order: Order, unit: Description) -> Description:
    """Words for an order and a unit."""
    problems, remedies = order.problems(), order.remedies()
    problem = " and ".join(filter(None, (problems[0], unit.problem, problems[1])))
    return Description(problem, ", then ".join(filter(None, (remedies[0], unit.remedy, remedies[1]))))


def _own_origins(template: Float[np.ndarray, "p 3"], views: Views) -> Iterator[Explanation]:
    """Landmarks that count from the corner of a crop in each image, which may have been resized."""
    compare = "; or compare the numbers of cameras with those of the images"
    crop = Description(
        "count from another corner in each image, as in crops", f"add the corner of each image's crop{compare}"
    )
    resized = Description(
        "belong to another crop of each image, in another resolution",
        "multiply those of each image by the size of its crop before it was resized over that after, add its corner"
        + compare,
    )
    starts = (views.landmarks, centred_pixels(views))
    for words, form, pixels in zip((crop, resized), map(OwnForm, (False, True)), starts, strict=True):
        fit = fit_map(template, views, form, np.zeros(0), pixels)
        doubt = ODD_MAP + (UNKNOWN if form.scaled else _odd_size(fit))
        yield Explanation(doubt, 3, fit, form, Order(), words, _pixels(fit, views))


def _one_camera_is_off(template: Float[np.ndarray, "p 3"], views: Views, stated: MapFit) -> bool:
    """Whether all other cameras agree as stated, or two are too few to tell."""
    count = views.seen.shape[1]
    for camera in range(count):
        rest = Views(*(np.delete(array, camera, axis=1) for array in views))
        if count < 3 or fit_map(template, rest, NO_MISTAKE.form, np.zeros(0), rest.landmarks).error <= (
            OWN_BETTER * stated.error
        ):
            return True
    return False


def _odd_size(fit: MapFit) -> float:
    """What the size of the head speaks against a mistake."""
    return float(min(abs(np.log(fit.head_size)) / np.log(USUAL_SIZE), ODD_SIZE))


def _pixels(fit: MapFit, views: Views) -> Float[np.ndarray, "t c p 2"]:
    return fit.image_map.scale * views.landmarks + fit.image_map.offset


def _refusal(found: list[Explanation], stated: MapFit, file: str) -> InputError:
    """Name the likeliest mistake, and those that are as likely."""
    likely = [found[0]]
    for other in found[1:]:
        as_likely = other.doubt < found[0].doubt + DIFFERENT and other.unknowns <= found[0].unknowns
        if as_likely and not any(_same(other, known) for known in likely):
            likely.append(other)
    evidence = f"the mean head is then {_words(found[0].fit)}, as stated {_words(stated)}"
    problem = f"the landmarks {', or '.join(explanation.description.problem for explanation in likely)} ({evidence})"
    remedy = "; or ".join(explanation.description.remedy for explanation in likely)
    return InputError(problem, file=file, field="landmarks", remedy=remedy)


def _words(fit: MapFit) -> str:
    return f"{fit.head_error:.1%} of the face's size off and rays {fit.ray_error:.1%}"


def _same(one: Explanation, other: Explanation) -> bool:
    """Whether two mistakes put the landmarks at the same pixels."""
    size = float(np.median(np.ptp(one.pixels, axis=2)))
    return one.order == other.order and float(np.median(np.abs(one.pixels - other.pixels))) <= SAME_MAP * size


def check_residuals(residuals: Float[np.ndarray, " c"], observations: Observations, file: str) -> None:
    """Refuse a fit whose reprojection errors no landmarks of a face can have.

    Args:
        residuals: Median error of each camera in pixels, NaN for a camera without landmarks.
        observations: The landmarks in the images.
        file: Where the landmarks come from, for messages.

    Raises:
        InputError: If the errors of most cameras, or of one of two, are larger than `LARGEST_ERROR`.
    """
    sizes = face_sizes(observations)
    known = np.isfinite(residuals)
    impossible = known & (residuals > np.maximum(LARGEST_ERROR * sizes, LEAST_ERROR))
    if impossible.sum() > known.sum() / 2 or (known.sum() < 3 and impossible.any()):
        worst = int(np.argmax(np.where(impossible, residuals / sizes, -np.inf)))
        share = f"{residuals[worst] / sizes[worst]:.0%} of the size of the face"
        where = f"in {int(impossible.sum())} of {int(known.sum())} cameras"
        problem = f"the fitted head is {residuals[worst]:.1f} pixels off the landmarks, {share}, {where}"
        remedy = "compare order and unit of the landmarks with the embedding, and the cameras with the calibration"
        raise InputError(problem, file=file, field="landmarks", remedy=remedy)


def face_sizes(observations: Observations) -> Float[np.ndarray, " c"]:
    """Size of the face in the images of each camera.

    Args:
        observations: The landmarks in the images.

    Returns:
        Root mean square distance of the landmarks from their mean in pixels, the median over the timesteps; 0 for a
        camera without landmarks.
    """
    sizes = np.linalg.norm(spreads(observations.pixels, observations.confidence > 0), axis=-1)
    return np.array([np.median(column[column > 0]) if (column > 0).any() else 0.0 for column in sizes.T])
