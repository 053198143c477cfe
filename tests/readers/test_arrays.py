"""Conversions that would change values are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from carigs.errors import InputError
from carigs.readers.arrays import checked_array

KINDS = st.one_of(hnp.boolean_dtypes(), hnp.integer_dtypes(), hnp.unsigned_integer_dtypes(), hnp.floating_dtypes())
TARGETS = st.sampled_from([np.int32, np.int64, np.uint16, np.float32, np.float64])


@given(array=KINDS.flatmap(lambda dtype: hnp.arrays(dtype, hnp.array_shapes(max_dims=2, max_side=4))), dtype=TARGETS)
def test_values_survive_the_conversion_or_it_is_refused(array, dtype):
    try:
        found = checked_array({"x": array}, "x", dtype=dtype, file="a.npz")
    except InputError:
        return
    assert found.dtype == dtype and np.isfinite(found).all()
    assert np.allclose(found.astype(np.longdouble), array.astype(np.longdouble), rtol=1e-6, atol=1e-37)
    if np.issubdtype(dtype, np.integer):
        assert array.dtype.kind != "b" and (found == array).all()


@pytest.mark.parametrize(
    ("array", "dtype"),
    [
        (np.array([0, 2**32], np.uint64), np.int32),
        (np.array([0.5]), np.int32),
        (np.array([np.nan]), np.int64),
        (np.array([1e300]), np.float32),
        (np.array([1 + 2j]), np.float32),
        (np.array([True]), np.int64),
        (np.array(["1"]), np.int64),
        (np.array([None]), np.float64),
        ([[1], [1, 2]], np.float64),
    ],
)
def test_what_would_wrap_or_lose_a_part_is_refused(array, dtype):
    with pytest.raises(InputError, match="x"):
        checked_array({"x": array}, "x", dtype=dtype, file="a.npz")


def test_indices_have_a_range():
    assert checked_array({"f": np.array([0, 4])}, "f", (None,), np.int32, below=5, file="a.npz").tolist() == [0, 4]
    for bad in ([5], [-1]):
        with pytest.raises(InputError, match=r"0\.\.4"):
            checked_array({"f": np.array(bad)}, "f", (None,), np.int32, below=5, file="a.npz")
