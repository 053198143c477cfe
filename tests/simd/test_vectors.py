"""The vector type: its functions against numpy, its loads and stores against slices."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.simd.memory import (
    gather_rows,
    load,
    load2,
    load3,
    load4,
    load_block,
    load_rows,
    store,
    store2,
    store3,
    store4,
    store9,
    store_block,
    store_rows,
)
from carigs.simd.vector_math import exp, exp2, halves, joined, log2, maximum, minimum, reduce_add, select, whole_bits
from carigs.simd.vectors import WIDTH, simd_inline

sixteen = dict(min_size=WIDTH, max_size=WIDTH)


@numba.njit
def _exponentials(x, out):
    store(out, 0, exp(load(x, 0)))
    store(out, WIDTH, exp2(load(x, 0)))


@given(st.lists(st.floats(-80, 80, width=32), **sixteen))
@settings(max_examples=60, deadline=None)
def test_exponentials_are_right_to_rounding(values):
    x, out = np.array(values, np.float32), np.empty(2 * WIDTH, np.float32)
    _exponentials(x, out)
    # e^x goes through base 2: an exponent of 115 has an error of 4e-6 before it is raised.
    np.testing.assert_allclose(out[:WIDTH], np.exp(x.astype(float)), rtol=6e-6)
    np.testing.assert_allclose(out[WIDTH:], np.exp2(x.astype(float)), rtol=2.5e-7)


@numba.njit(error_model="numpy")
def _logarithm(x, out):
    a, b = halves(load(x, 0))
    store(out, 0, joined(log2(a), log2(b)))


@given(st.lists(st.floats(np.float32(1e-30).item(), np.float32(1e30).item(), width=32), **sixteen))
@settings(max_examples=60, deadline=None)
def test_the_logarithm_is_right_to_rounding(values):
    x, out = np.array(values, np.float32), np.empty(WIDTH, np.float32)
    _logarithm(x, out)
    np.testing.assert_allclose(out, np.log2(x.astype(float)), rtol=1e-7, atol=1e-12)


@numba.njit
def _choices(x, y, out):
    a, b = load(x, 0), load(y, 0)
    store(out, 0, minimum(a, b))
    store(out, WIDTH, maximum(a, b))
    store(out, 2 * WIDTH, select((a < b) & (a > 0.0), a, 7.0))
    store(out, 3 * WIDTH, -a * 2 - 1)


def test_comparisons_are_false_with_nan():
    x, y = np.linspace(-1, 1, WIDTH, dtype=np.float32), np.zeros(WIDTH, np.float32) + np.float32(0.5)
    x[3], y[5] = np.nan, np.nan
    out = np.empty((4, WIDTH), np.float32)
    _choices(x, y, out.reshape(-1))
    less, more = x < y, x > y
    np.testing.assert_array_equal(out[0], np.where(less, x, y))
    np.testing.assert_array_equal(out[1], np.where(more, x, y))
    np.testing.assert_array_equal(out[2], np.where(less & (x > 0), x, 7))
    np.testing.assert_allclose(out[3], -2 * x - 1, rtol=1e-6)


def _records(count):
    return np.random.default_rng(count).random((WIDTH, count)).astype(np.float32)


@simd_inline
def _tuple2(c):
    return load(c, 0), load(c, 16)


@simd_inline
def _tuple3(c):
    return (*_tuple2(c), load(c, 32))


@simd_inline
def _tuple4(c):
    return (*_tuple3(c), load(c, 48))


@simd_inline
def _tuple9(c):
    return (*_tuple4(c), load(c, 64), load(c, 80), load(c, 96), load(c, 112), load(c, 128))


@pytest.mark.parametrize(("count", "read"), [(2, load2), (3, load3), (4, load4), (16, None)])
def test_fields_of_records_become_vectors(count, read):
    @numba.njit
    def split(records, columns):
        fields = read(records, 0)
        for k in range(count):
            store(columns, k * WIDTH, fields[k])

    @numba.njit
    def split_rows(records, columns):
        fields = load_rows(records, 0, WIDTH)
        for k in range(count):
            store(columns, k * WIDTH, fields[k])

    records, columns = _records(count), np.empty((count, WIDTH), np.float32)
    (split_rows if read is None else split)(records.reshape(-1), columns.reshape(-1))
    np.testing.assert_array_equal(columns, records.T)


@pytest.mark.parametrize(
    ("count", "write", "fields"),
    [(2, store2, _tuple2), (3, store3, _tuple3), (4, store4, _tuple4), (9, store9, _tuple9)],
)
def test_vectors_become_fields_of_records(count, write, fields):
    @numba.njit
    def merge(columns, records):
        write(records, 0, fields(columns))

    records, back = _records(count), np.empty((WIDTH, count), np.float32)
    merge(np.ascontiguousarray(records.T).reshape(-1), back.reshape(-1))
    np.testing.assert_array_equal(back, records)


@numba.njit
def _rows_there_and_back(rows, chosen, gathered, stored):
    fields = gather_rows(rows, chosen, 0, 20, 4)
    for k in range(WIDTH):
        store(gathered, k * WIDTH, fields[k])
    store_rows(stored, 2, 20, fields)


def test_rows_are_gathered_and_stored_with_any_stride():
    rows, chosen = _records(40 * 20).reshape(-1, 20)[:40], np.random.default_rng(1).integers(0, 40, WIDTH)
    gathered, stored = np.empty((WIDTH, WIDTH), np.float32), np.zeros((WIDTH, 20), np.float32)
    _rows_there_and_back(rows.reshape(-1), chosen.astype(np.int32), gathered.reshape(-1), stored.reshape(-1))
    np.testing.assert_array_equal(gathered.T, rows[chosen, 4:])
    np.testing.assert_array_equal(stored[:, 2:18], rows[chosen, 4:])
    assert not stored[:, [0, 1, 18, 19]].any()


@numba.njit
def _block_there_and_back(image, lanes, back):
    block = load_block(image, 3 * 9 + 2, 9)
    store(lanes, 0, block)
    store_block(back, 3 * 9 + 2, 9, block)


def test_blocks_of_pixels_are_columns_first():
    image, back = np.arange(81, dtype=np.float32).reshape(9, 9), np.zeros((9, 9), np.float32)
    lanes = np.empty(WIDTH, np.float32)
    _block_there_and_back(image.reshape(-1), lanes, back.reshape(-1))
    np.testing.assert_array_equal(lanes.reshape(4, 4).T, image[3:7, 2:6])
    np.testing.assert_array_equal(back[3:7, 2:6], image[3:7, 2:6])
    assert np.count_nonzero(back) == 16


@numba.njit
def _sums(rows, out, ints):
    r = load_rows(rows, 0, WIDTH)
    t = reduce_add(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15])
    store(out, 0, t)
    store(ints, 0, whole_bits(t))


def test_sums_over_lanes_and_whole_numbers():
    rows = np.random.default_rng(2).integers(-50, 50, (WIDTH, WIDTH)).astype(np.float32)
    out, ints = np.empty(WIDTH, np.float32), np.empty(WIDTH, np.int32)
    _sums(rows.reshape(-1), out, ints)
    np.testing.assert_array_equal(out, rows.sum(axis=0))
    np.testing.assert_array_equal(ints, rows.sum(axis=0))
