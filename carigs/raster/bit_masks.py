"""Image masks packed into bits, 64 rows to a machine word, so that operations on a mask handle 64 pixels at a time.

A horizontal shift of a mask moves words, a vertical shift moves bits. Both are plain loops over a row of words, which
LLVM vectorises.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int32, Shaped, UInt64
from numba import types
from numba.extending import intrinsic

from carigs.simd.ir_values import generate
from carigs.simd.kernels import kernel

BITS, LOG = 64, 6
ZERO, ONE, ALL = np.uint64(0), np.uint64(1), np.uint64(0xFFFFFFFFFFFFFFFF)
_DILATION_STEP = 8  # pixels


@dataclass(frozen=True)
class BitMask:
    """A mask of h rows and w columns. The operators & | ~ and - (difference) combine masks of the same size."""

    words: UInt64[np.ndarray, "j w"]
    """Bit b of word j is row 64 j + b; rows from `height` on are 0."""
    height: int

    def __and__(self, other: BitMask) -> BitMask:
        return BitMask(self.words & other.words, self.height)

    def __or__(self, other: BitMask) -> BitMask:
        return BitMask(self.words | other.words, self.height)

    def __sub__(self, other: BitMask) -> BitMask:
        return BitMask(self.words & ~other.words, self.height)

    def __invert__(self) -> BitMask:
        return BitMask(complement(self.words, self.height), self.height)

    def __bool__(self) -> bool:
        """Whether the mask contains any pixel."""
        return bool(self.words.any())

    def dilated(self, radius: int) -> BitMask:
        """Dilation by a disc, with the same disc as OpenCV's `MORPH_ELLIPSE`.

        Args:
            radius: In pixels; 0 or less leaves the mask as it is.

        Returns:
            The pixels within the disc around any pixel of the mask.
        """
        return BitMask(_dilate(self.words, max(radius, 0), self.height), self.height)

    def covering_radius(self, other: BitMask) -> int:
        """Least radius at which this mask, dilated, contains another mask, to about two pixels or 4 %.

        Args:
            other: Mask of the same size.

        Returns:
            Radius in pixels: 0 if the other mask is contained, more than any distance in the image if this mask is
            empty and the other is not.
        """
        if not other - self:
            return 0
        diagonal = self.height + self.words.shape[1]
        if not self:
            return diagonal
        radius, dilated = 0, self
        while radius < diagonal and other - (larger := dilated.dilated(_DILATION_STEP)):
            dilated, radius = larger, radius + _DILATION_STEP
        low, high = 0, _DILATION_STEP  # dilated by `low`, it does not contain the other
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if other - dilated.dilated(middle) else (low, middle)
        return radius + high

    def to_array(self) -> Bool[np.ndarray, "h w"]:
        """Unpack the mask.

        Returns:
            True at the pixels of the mask.
        """
        image = np.zeros((self.height, self.words.shape[1]), np.uint16)
        or_into_image(image, self.words, 1)
        return image > 0


def greater(image: Shaped[np.ndarray, "h w"], threshold: float) -> BitMask:
    """Pixels with a value above a threshold.

    Args:
        image: Any numeric type.
        threshold: Compared in the image's type.

    Returns:
        Mask of the pixels with image > threshold.
    """
    return BitMask(_greater(image, image.dtype.type(threshold)), image.shape[0])


def pixels_of_faces(face_image: Int32[np.ndarray, "h w"], faces: Bool[np.ndarray, " f"]) -> BitMask:
    """Pixels that show one of the selected faces.

    Args:
        face_image: Face index per pixel, -1 where there is none.
        faces: Whether each face is selected.

    Returns:
        Mask of those pixels.
    """
    return BitMask(_pixels_of_faces(face_image, np.concatenate([[0], faces]).astype(np.int32)), face_image.shape[0])


@kernel
def _greater(image, threshold):
    height, width = image.shape
    words = np.zeros(((height + BITS - 1) // BITS, width), np.uint64)
    for y in range(height):
        for x in range(width):
            words[y >> LOG, x] |= np.uint64(image[y, x] > threshold) << np.uint64(y & 63)
    return words


@kernel
def _pixels_of_faces(face_image, table):
    """`table` is offset by one: its first entry is the value where there is no face."""
    height, width = face_image.shape
    words = np.zeros(((height + BITS - 1) // BITS, width), np.uint64)
    for y in range(height):
        for x in range(width):
            words[y >> LOG, x] |= np.uint64(table[np.uint64(face_image[y, x] + 1)]) << np.uint64(y & 63)
    return words


@kernel
def complement(words, height):
    """Complement of a mask.

    Args:
        words: Words (j, w) of a `BitMask`.
        height: Rows of the image; bits of later rows stay 0.

    Returns:
        Words of the complement.
    """
    result = ~words
    if height & 63:
        result[-1] &= ALL >> np.uint64(BITS - (height & 63))
    return result


@kernel
def _dilate_word_row(result, words, before, after, rows):
    """Dilate one row of words by 1 <= `rows` < 64 up and down, given the rows of words before and after it."""
    near, far = np.uint64(rows), np.uint64(BITS - rows)
    for x in range(len(result)):
        result[x] = words[x] | words[x] << near | words[x] >> near | before[x] >> far | after[x] << far


@kernel
def dilate_vertically(words, rows):
    """Dilate a mask up and down.

    Args:
        words: Words (j, w) of a `BitMask`.
        rows: Distance in pixels, 1 to 63.

    Returns:
        Words of the dilated mask. Bits below the image's last row may be set.
    """
    last = words.shape[0] - 1
    result, zeros = np.empty_like(words), np.zeros(words.shape[1], np.uint64)
    for j in range(last + 1):
        before, after = words[j - 1] if j else zeros, words[j + 1] if j < last else zeros
        _dilate_word_row(result[j], words[j], before, after, rows)
    return result


@kernel
def _or(result, words):
    for x in range(len(result)):
        result[x] |= words[x]


@kernel
def or_shifted(result, words, columns):
    """Combine a mask, in place, with another one shifted to the right and to the left.

    Args:
        result: Words (j, w) that are updated.
        words: Words (j, w) of the other mask.
        columns: Distance in pixels, 0 or more.
    """
    width = words.shape[1]
    for j in range(words.shape[0] if columns < width else 0):
        _or(result[j, columns:], words[j, : width - columns])
        _or(result[j, : width - columns], words[j, columns:])


@kernel
def _dilate(words, radius, height):
    """Dilate by the columns of a disc, from the outermost and shortest one to the middle."""
    tall, result, half = words, words.copy(), 0
    for column in range(radius, -1, -1):
        target = half
        while target < radius and np.rint(np.sqrt(float(radius**2 - (target + 1) ** 2))) >= column:
            target += 1
        while half < target:
            step = min(target - half, 2 * half + 1, BITS - 1)
            tall, half = dilate_vertically(tall, step), half + step
        or_shifted(result, tall, column)
    return complement(complement(result, height), height)


@kernel
def or_into_image(image, words, value):
    """Set bits of an image's values, in place, at the pixels of a mask.

    Args:
        image: 16-bit values (h, w).
        words: Words (j, w) of the mask.
        value: Bits to set.
    """
    number = np.uint16(value)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            image[y, x] |= np.uint16((words[y >> LOG, x] >> np.uint64(y & 63)) & ONE) * number


@intrinsic
def popcount(typingctx, word):
    """Number of bits of a 64-bit word that are set.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        word: The word.

    Returns:
        The number.
    """
    return types.uint64(types.uint64), generate(lambda word: word.call("ctpop"))
