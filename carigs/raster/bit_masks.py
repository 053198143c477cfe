"""Masks of an image as bits, 64 rows to a word: what takes a pass over all pixels elsewhere takes a 64th of them.

Moving a mask sideways moves its words, moving it up or down shifts them: plain loops over a row of words, which LLVM
makes vector code of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Int32, Shaped, UInt64
from numba import types
from numba.extending import intrinsic

BITS, LOG = 64, 6
STEP = 8  # pixels
NONE, ONE, ALL = np.uint64(0), np.uint64(1), np.uint64(0xFFFFFFFFFFFFFFFF)

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


@dataclass(frozen=True)
class Bits:
    """A mask of h rows and w columns; operators & | ~ and - (without) between masks of one size."""

    words: UInt64[np.ndarray, "j w"]
    """Bit b of word j is row 64 j + b; rows from `height` on are 0."""
    height: int

    def __and__(self, other: Bits) -> Bits:
        return Bits(self.words & other.words, self.height)

    def __or__(self, other: Bits) -> Bits:
        return Bits(self.words | other.words, self.height)

    def __sub__(self, other: Bits) -> Bits:
        return Bits(self.words & ~other.words, self.height)

    def __invert__(self) -> Bits:
        return Bits(inverse(self.words, self.height), self.height)

    def __bool__(self) -> bool:
        """Whether any pixel is in the mask."""
        return bool(self.words.any())

    def grown(self, radius: int) -> Bits:
        """All pixels within a disc, as OpenCV draws it, around those of the mask."""
        return Bits(_grown(self.words, max(radius, 0), self.height), self.height)

    def reach(self, other: Bits) -> int:
        """The least radius at which this mask, grown, holds the `other`, to about two pixels or 4 %: grown in steps.

        More than any distance if the mask is empty and the other is not.
        """
        if not other - self:
            return 0
        most = self.height + self.words.shape[1]
        if not self:
            return most
        whole, held = 0, self
        while whole < most and other - (grown := held.grown(STEP)):
            held, whole = grown, whole + STEP
        low, high = 0, STEP  # grown by `low` it does not hold the other
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if other - held.grown(middle) else (low, middle)
        return whole + high

    def image(self) -> Bool[np.ndarray, "h w"]:
        """The mask as it is elsewhere."""
        image = np.zeros((self.height, self.words.shape[1]), np.uint16)
        add(image, self.words, 1)
        return image > 0


def above(image: Shaped[np.ndarray, "h w"], limit: float) -> Bits:
    """The pixels whose value is larger."""
    return Bits(_above(image, image.dtype.type(limit)), image.shape[0])


def chosen(face_image: Int32[np.ndarray, "h w"], faces: Bool[np.ndarray, "f"]) -> Bits:
    """The pixels that show one of the chosen faces."""
    return Bits(_chosen(face_image, np.concatenate([[0], faces]).astype(np.int32)), face_image.shape[0])


@kernel
def _above(image, limit):
    height, width = image.shape
    words = np.zeros(((height + BITS - 1) // BITS, width), np.uint64)
    for y in range(height):
        for x in range(width):
            words[y >> LOG, x] |= np.uint64(image[y, x] > limit) << np.uint64(y & 63)
    return words


@kernel
def _chosen(face_image, table):
    """`table` begins with what holds where there is no face."""
    height, width = face_image.shape
    words = np.zeros(((height + BITS - 1) // BITS, width), np.uint64)
    for y in range(height):
        for x in range(width):
            words[y >> LOG, x] |= np.uint64(table[np.uint64(face_image[y, x] + 1)]) << np.uint64(y & 63)
    return words


@kernel
def inverse(words, height):
    """Bits of the rows below `height` only."""
    turned = ~words
    if height & 63:
        for x in range(words.shape[1]):
            turned[-1, x] &= ALL >> np.uint64(BITS - (height & 63))
    return turned


@kernel
def _stretch(result, words, before, after, rows):
    """A row of words, each pixel stretched up and down by 1 <= `rows` < 64."""
    near, far = np.uint64(rows), np.uint64(BITS - rows)
    for x in range(len(result)):
        result[x] = words[x] | words[x] << near | words[x] >> near | before[x] >> far | after[x] << far


@kernel
def stretched(words, rows):
    """Each pixel stretched up and down by 1 <= `rows` < 64; what leaves the image may stay in spare rows."""
    last = words.shape[0] - 1
    result, none = np.empty_like(words), np.zeros(words.shape[1], np.uint64)
    for j in range(last + 1):
        _stretch(result[j], words[j], words[j - 1] if j else none, words[j + 1] if j < last else none, rows)
    return result


@kernel
def _add(result, words):
    for x in range(len(result)):
        result[x] |= words[x]


@kernel
def add_beside(result, words, columns):
    """Result |= the mask moved to the right, and to the left."""
    width = words.shape[1]
    for j in range(words.shape[0] if columns < width else 0):
        _add(result[j, columns:], words[j, : width - columns])
        _add(result[j, : width - columns], words[j, columns:])


@kernel
def _grown(words, radius, height):
    """Grown by the columns of a disc, from the outermost on, which is the shortest."""
    tall, grown, half = words, words.copy(), 0
    for column in range(radius, -1, -1):
        wanted = half
        while wanted < radius and np.rint(np.sqrt(float(radius**2 - (wanted + 1) ** 2))) >= column:
            wanted += 1
        while half < wanted:
            step = min(wanted - half, 2 * half + 1, BITS - 1)
            tall, half = stretched(tall, step), half + step
        add_beside(grown, tall, column)
    return inverse(inverse(grown, height), height)


@kernel
def add(image, words, value):
    """Image |= value where the mask is."""
    number = np.uint16(value)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            image[y, x] |= np.uint16((words[y >> LOG, x] >> np.uint64(y & 63)) & ONE) * number


@intrinsic
def count(typingctx, word):
    """Bits of a word that are set."""

    def codegen(context, builder, signature, values):
        return builder.ctpop(values[0])

    return types.uint64(types.uint64), codegen
