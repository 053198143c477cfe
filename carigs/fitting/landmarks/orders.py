"""Orders of landmarks: x and y exchanged, counted from the other side, or each landmark with its mirror partner."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from carigs.fitting.landmarks.image_map import Views

ASYMMETRY = 0.1
"""Distance of a landmark from the reflection of its mirror partner, in sizes of the face, up to which both are one."""


class Order(NamedTuple):
    """How coordinates and landmarks are ordered, other than stated."""

    exchanged: bool = False
    """y before x."""
    from_the_right: bool = False
    from_the_bottom: bool = False
    partners: tuple[int, ...] | None = None
    """The landmark in the place of each; None: its own."""

    def undone(self, views: Views) -> Views:
        """Landmarks in the stated order, and cameras whose images are turned over in place of the landmarks.

        Args:
            views: The landmarks.

        Returns:
            Views for which a map with positive scales is to be found; its pixels count from the sides of this order.
        """
        landmarks, seen = views.landmarks, views.seen
        if self.partners is not None:
            landmarks, seen = landmarks[:, :, list(self.partners)], seen[:, :, list(self.partners)]
        if self.exchanged:
            landmarks = landmarks[..., ::-1]
        projections = views.projections.copy()
        for axis in self.turned_axes:  # x becomes w - x
            size = views.sizes[..., axis]
            projections[:, :, axis] = size * projections[:, :, 2] - projections[:, :, axis]
        return Views(landmarks, seen, projections, views.sizes)

    @property
    def turned_axes(self) -> list[int]:
        """Axes that count from the other side."""
        return [axis for axis, turned in enumerate((self.from_the_right, self.from_the_bottom)) if turned]

    def problems(self) -> tuple[str, str]:
        """What is wrong, before and after the unit.

        Returns:
            What follows `the landmarks`; empty if nothing is.
        """
        after = {
            (False, False): "",
            (False, True): "have y from the bottom",
            (True, False): "have x from the right",
            (True, True): "are turned by 180 degrees",
        }[self.from_the_right, self.from_the_bottom]
        if self.partners is not None:
            swapped = "have left and right exchanged (each is its mirror partner)"
            after = f"{after} and {swapped}" if after else swapped
        return ("have y before x (row, column)" if self.exchanged else ""), after

    def remedies(self) -> tuple[str, str]:
        """What to do, before and after the remedy of the unit.

        Returns:
            Instructions; empty if nothing is to be done.
        """
        sides = [text for text, turned in (("w - x", self.from_the_right), ("h - y", self.from_the_bottom)) if turned]
        after = f"write {' and '.join(sides)}" if sides else ""
        if self.partners is not None:
            swap = "exchange the indices of mirror partners"
            after = f"{after}, then {swap}" if after else swap
        return ("exchange the two" if self.exchanged else ""), after


def orders(template: Float[np.ndarray, "p 3"]) -> Iterator[Order]:
    """All orders, the stated one first.

    Args:
        template: The landmarks on the head model: x to its left.

    Yields:
        8 orders; 16 if the landmarks are symmetric.
    """
    partners = mirror_partners(template)
    for swapped in (None,) if partners is None else (None, tuple(partners.tolist())):
        for exchanged, right, bottom in product((False, True), repeat=3):
            yield Order(exchanged, right, bottom, swapped)


def mirror_partners(template: Float[np.ndarray, "p 3"]) -> Int[np.ndarray, " p"] | None:
    """Which landmark of the head model is the reflection of which.

    Args:
        template: The landmarks: x to the left.

    Returns:
        The partner of each, itself in the middle plane; None if the landmarks are not symmetric.
    """
    reflected = template * np.array([-1, 1, 1]) + np.array([2 * template[:, 0].mean(), 0, 0])
    distances = np.linalg.norm(template[:, None] - reflected, axis=-1)
    _, partners = linear_sum_assignment(distances)
    size = np.sqrt(((template - template.mean(axis=0)) ** 2).sum(axis=1).mean())
    symmetric = distances[np.arange(len(template)), partners].max() <= ASYMMETRY * size
    if not symmetric or (partners[partners] != np.arange(len(template))).any():
        return None
    return None if (partners == np.arange(len(template))).all() else partners
