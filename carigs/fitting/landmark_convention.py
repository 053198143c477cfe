"""Are landmarks in pixels of the images, x before y, from the upper left corner?

Landmarks in another unit or order are found by trying: a similarity brings the head model's landmarks onto the
triangulated ones, and the cameras project them. With the right convention they lie within a few hundredths of the size
of the face in the images, whatever the unit of the cameras and the person; with a wrong one they do not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from carigs.errors import InputError
from carigs.fitting.landmark_fit import Observations
from carigs.fitting.triangulation import LEAST_POINTS, project, triangulate, well_seen_timesteps
from carigs.mesh.rigid_alignment import rigid_alignment

TIMESTEPS = 4
"""Timesteps that are triangulated."""
SUSPICIOUS = 0.1
"""Misfit of the mean head from which other conventions are tried, in sizes of the face. It is 0.04 with a pixel of
noise on `ict_s1` and `ict_s7`, 0.08 with three pixels, and 0.10 for a detector on a real person."""
BETTER, BELIEVED = 0.5, 0.15
"""A convention is believed if it leaves less than this share of the misfit, and no more than that."""
NO_PIXELS = 2.0
"""Coordinates of a whole face up to this are shares of something."""
LARGEST_ERROR = 0.1
"""Reprojection error of a fitted head, in sizes of the face in the image: 5 mm on a head. Benchmarks of detectors
(300-W, Sagonas et al. 2013) count an image as a failure at about this error."""
LEAST_ERROR = 1.0
"""Pixels that are no failure however small the face."""

Pixels = Float[np.ndarray, "t c p 2"]
Sizes = Float[np.ndarray, "t c 1 2"]
"""Width and height of the images."""


class Convention(NamedTuple):
    """Another unit or order of the coordinates."""

    problem: str
    remedy: str
    undo: Callable[[Pixels, Sizes], Pixels]


def _conventions() -> Iterator[Convention]:
    """Each unit with each order."""
    units = [
        Convention("", "", lambda p, size: p),
        Convention("are shares of the image's size", "multiply x by w and y by h", lambda p, size: p * size),
        Convention(
            "run from -1 to 1 over the image",
            "write (x + 1) w / 2 and (y + 1) h / 2",
            lambda p, size: (p + 1) / 2 * size,
        ),
    ]
    for resolution, factor in (
        ("twice", 0.5), ("half", 2.0), ("four times", 0.25), ("a quarter of", 4.0), ("three times", 1 / 3),
        ("a third of", 3.0), ("1.5 times", 2 / 3), ("two thirds of", 1.5),
    ):  # fmt: skip
        problem = f"belong to images of {resolution} the resolution"
        remedy = f"multiply x and y by {factor:.4g}"
        units.append(Convention(problem, remedy, lambda p, size, factor=factor: factor * p))
    orders = [
        Convention("", "", lambda p, size: p),
        Convention("have y from the bottom", "write h - y", lambda p, size: _from_the_end(p, size, [1])),
        Convention("have x from the right", "write w - x", lambda p, size: _from_the_end(p, size, [0])),
        Convention(
            "are turned by 180 degrees", "write w - x and h - y", lambda p, size: _from_the_end(p, size, [0, 1])
        ),
    ]
    exchanged = Convention("have y before x (row, column)", "exchange the two", lambda p, size: p[..., ::-1])
    for unit in units:
        yield _in_turn(exchanged, unit)
        for order in orders:
            if unit.problem or order.problem:
                yield _in_turn(unit, order)


def _in_turn(first: Convention, second: Convention) -> Convention:
    """Both mistakes, undone in this order."""
    return Convention(
        " and ".join(filter(None, (first.problem, second.problem))),
        ", then ".join(filter(None, (first.remedy, second.remedy))),
        lambda p, size: second.undo(first.undo(p, size), size),
    )


def _from_the_end(pixels: Pixels, sizes: Sizes, axes: list[int]) -> Pixels:
    changed = pixels.copy()
    changed[..., axes] = sizes[..., axes] - pixels[..., axes]
    return changed


def check_convention(
    template: Float[np.ndarray, "p 3"], observations: Observations, sizes: Float[np.ndarray, "t c 2"], file: str
) -> None:
    """Refuse landmarks in another unit or order.

    Args:
        template: The landmarks on the head model, in metres.
        observations: The landmarks in the images.
        sizes: Width and height of the images.
        file: Where the landmarks come from, for messages.

    Raises:
        InputError: If another convention explains the landmarks, which it names, or they cannot be pixels.
    """
    chosen = well_seen_timesteps(observations.confidence, TIMESTEPS)
    pixels, confidence, projections = (
        values[chosen] for values in (observations.pixels, observations.confidence, observations.projections)
    )
    stated = _misfit(template, pixels, confidence, projections)
    if stated <= SUSPICIOUS:
        return
    size, tried = sizes[chosen][:, :, None], []
    for convention in _conventions():
        tried.append((_misfit(template, convention.undo(pixels, size), confidence, projections), convention))
    misfit, convention = min(tried, key=lambda pair: pair[0])
    if misfit < BETTER * stated and misfit <= BELIEVED:
        evidence = f"then the head is {misfit:.1%} of the face's size off the landmarks, as stated {stated:.1%}"
        problem = f"the landmarks {convention.problem} ({evidence})"
        raise InputError(problem, file=file, field="landmarks", remedy=convention.remedy)
    largest = float(np.abs(pixels[confidence > 0]).max())
    if largest <= NO_PIXELS:
        problem = f"the landmarks lie within {largest:.3g} of the corner of the image: they are no pixels"
        raise InputError(problem, file=file, field="landmarks", remedy="multiply x and y by what they were divided by")


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
    sizes = _sizes(observations.pixels, observations.confidence > 0)
    return np.array([np.median(column[column > 0]) if (column > 0).any() else 0.0 for column in sizes.T])


def _sizes(points: Float[np.ndarray, "*n p d"], seen: Bool[np.ndarray, "*n p"]) -> Float[np.ndarray, "*n"]:
    """Root mean square distance of the seen points from their mean."""
    weights = seen / np.maximum(seen.sum(axis=-1, keepdims=True), 1)
    centred = points - np.einsum("...p,...pd->...d", weights, points)[..., None, :]
    return np.asarray(np.sqrt(np.einsum("...p,...pd,...pd->...", weights, centred, centred)))


def _misfit(
    template: Float[np.ndarray, "p 3"],
    pixels: Pixels,
    confidence: Float[np.ndarray, "t c p"],
    projections: Float[np.ndarray, "t c 3 4"],
) -> float:
    """Median distance between landmarks and the aligned template in the images, in sizes of the face there.

    Infinite if the landmarks lie behind the cameras.
    """
    seen, (points, _) = confidence > 0, triangulate(pixels, confidence, projections)
    sizes, misfits = _sizes(pixels, seen), []
    for t, target in enumerate(points):
        known = np.isfinite(target).all(axis=1)
        if known.sum() < LEAST_POINTS:
            continue
        scale = float(_sizes(target[known], known[known]) / _sizes(template[known], known[known]))
        rotation, translation = rigid_alignment(scale * template[known], target[known])
        projected, depth = project(scale * template @ rotation.T + translation, projections[t])
        distances = np.linalg.norm(projected - pixels[t], axis=-1)
        for c in np.flatnonzero(seen[t].sum(axis=1) >= LEAST_POINTS):
            behind = np.median(depth[c]) <= 0
            misfits.append(np.inf if behind else np.median(distances[c, seen[t, c]]) / max(sizes[t, c], 1e-9))
    return float(np.median(misfits)) if misfits else np.inf
