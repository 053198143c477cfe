"""Silhouettes against mattes: shares of pixels that can be counted by hand."""

import numpy as np
import pytest

from carigs.plausibility.diagnosis.reprojection import OFF_MESH, Overlap, silhouette_overlap

ABOVE_NECK = np.array([True, False])


def rectangle(rows: slice, columns: slice) -> np.ndarray:
    mask = np.zeros((20, 30), bool)
    mask[rows, columns] = True
    return mask


def faces(mask: np.ndarray, face: int = 0) -> np.ndarray:
    return np.where(mask, face, -1).astype(np.int32)


def test_equal_masks_fit_and_disjoint_ones_do_not():
    mask = rectangle(slice(5, 15), slice(5, 15))
    assert silhouette_overlap(faces(mask), mask, ABOVE_NECK) == Overlap(100, 0, 0)
    apart = silhouette_overlap(faces(rectangle(slice(5, 15), slice(16, 26))), mask, ABOVE_NECK)
    assert (apart.misfit, apart.iou, apart.outside_share) == (1, 0, 1)


def test_a_shift_moves_as_many_pixels_out_as_in():
    mask = rectangle(slice(5, 15), slice(5, 15))
    shifted = silhouette_overlap(faces(rectangle(slice(5, 15), slice(7, 17))), mask, ABOVE_NECK)
    assert shifted == Overlap(80, 20, 20)
    assert shifted.iou == pytest.approx(80 / 120)
    assert shifted.misfit == pytest.approx(1 - 80 / (80 + 20 + OFF_MESH * 20))


def test_hair_costs_less_than_a_mesh_outside_the_matte():
    small, large = rectangle(slice(5, 15), slice(5, 15)), rectangle(slice(3, 15), slice(3, 17))
    hair, overhang = (silhouette_overlap(faces(a), b, ABOVE_NECK) for a, b in ((small, large), (large, small)))
    assert hair.iou == overhang.iou
    assert hair.misfit < overhang.misfit


def test_below_the_matte_and_below_the_neck_nothing_counts_as_outside():
    matte = rectangle(slice(5, 15), slice(5, 15))
    assert silhouette_overlap(faces(rectangle(slice(5, 20), slice(5, 15))), matte, ABOVE_NECK) == Overlap(100, 0, 0)
    shoulders = np.where(rectangle(slice(13, 15), slice(0, 30)) & ~matte, 1, faces(matte)).astype(np.int32)
    assert silhouette_overlap(shoulders, matte, ABOVE_NECK) == Overlap(100, 0, 0)


def test_no_silhouette_is_the_worst_fit():
    nothing = silhouette_overlap(faces(np.zeros((20, 30), bool)), rectangle(slice(5, 15), slice(5, 15)), ABOVE_NECK)
    assert (nothing.misfit, nothing.outside_share, nothing.uncovered_share) == (1, 1, 1)
