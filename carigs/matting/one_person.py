"""A coarse matte of one of several people: networks find all."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

PERSON = 0.5
"""Coarse matte from which a pixel belongs to somebody."""
EDGE = 0.03
"""Width of the soft edge of a coarse matte, in sides of the image."""


def of_one_person(coarse: Float32[np.ndarray, "h w"], face: Float[np.ndarray, "4"]) -> Float32[np.ndarray, "h w"]:
    """Leave the other people out of a coarse matte.

    Heads are apart where shoulders touch. So what belongs to nobody's face is found above the chin first, and below it
    by what is connected to the rest.

    Args:
        coarse: Coarse matte in [0, 1].
        face: Left, top, right, bottom of the person's face in its pixels; NaN if it is not known.

    Returns:
        The matte without those who are apart from the face; all of it if the face is not known, or nobody is there.
    """
    if not np.isfinite(face).all():
        return coarse
    chin = int(np.clip(face[3], 0, len(coarse)))
    people = coarse > PERSON
    above = _at_the_face(people & (np.arange(len(coarse)) < chin)[:, None], face)
    person = above.copy()
    person[chin:] = people[chin:]
    person = _at_the_face(person, face)
    if not person.any():
        return coarse
    others = people & ~person
    radius = max(round(EDGE * max(coarse.shape)), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    distances = [cv2.distanceTransform((~part).astype(np.uint8), cv2.DIST_L2, 5) for part in (others, person)]
    left_out = cv2.dilate(others.astype(np.uint8), disc).astype(bool) & (distances[0] < distances[1])
    return np.where(left_out, np.float32(0), coarse)


def _at_the_face(people: Bool[np.ndarray, "h w"], face: Float[np.ndarray, "4"]) -> Bool[np.ndarray, "h w"]:
    """The connected part that covers most of the face's box; nothing if none does."""
    _, labels = cv2.connectedComponents(people.astype(np.uint8), connectivity=4)
    left, top, right, bottom = np.clip(face, 0, [*people.shape[::-1], *people.shape[::-1]]).astype(int)
    counts = np.bincount(labels[top:bottom, left:right].ravel(), minlength=2)
    counts[0] = 0
    return labels == counts.argmax() if counts.any() else np.zeros_like(people)
