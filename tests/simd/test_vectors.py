"""The vector type: its functions against numpy, its loads and stores against slices."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.simd.kernels import kernel
from carigs.simd.memory import load, load_block, store, store_block
from carigs.simd.records import gather_rows, load_records, store_records
from carigs.simd.reductions import reduce_add, reduce_add_each, reduce_max
from carigs.simd.tuples import add, divide, matrix_vector, multiply, outer, read_row, subtract, write_row
from carigs.simd.vector_loops import parallel_for_vectors
from carigs.simd.vector_math import (
    demote,
    exp,
    exp2,
    log2,
    maximum,
    minimum,
    promote_lower,
    promote_upper,
    select,
    to_int,
)
from carigs.simd.vectors import WIDTH, simd_inline, simd_inline_alloc

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
    a = load(x, 0)
    store(out, 0, demote(log2(promote_lower(a)), log2(promote_upper(a))))


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


COUNTS = (2, 3, 4, 9, 16, 20, 45)


@pytest.mark.parametrize("count", COUNTS)
def test_fields_of_records_become_vectors(count):
    read = load_records(count)

    @numba.njit
    def split(records, columns):
        fields = read(records, 0)
        for k in range(count):
            store(columns, k * WIDTH, fields[k])

    records, columns = _records(count), np.empty((count, WIDTH), np.float32)
    split(records.reshape(-1), columns.reshape(-1))
    np.testing.assert_array_equal(columns, records.T)


@pytest.mark.parametrize("count", COUNTS)
def test_vectors_become_fields_of_records(count):
    read, write = load_records(count), store_records(count)

    @numba.njit
    def there_and_back(records, back):
        write(back, 0, read(records, 0))

    records, back = _records(count), np.zeros((WIDTH, count), np.float32)
    there_and_back(records.reshape(-1), back.reshape(-1))
    np.testing.assert_array_equal(back, records)


@numba.njit
def _gather(rows, chosen, gathered):
    fields = gather_rows(rows, chosen, 0, 20, 4)
    for k in range(WIDTH):
        store(gathered, k * WIDTH, fields[k])


def test_rows_are_gathered_with_any_stride():
    rows, chosen = _records(40 * 20).reshape(-1, 20)[:40], np.random.default_rng(1).integers(0, 40, WIDTH)
    gathered = np.empty((WIDTH, WIDTH), np.float32)
    _gather(rows.reshape(-1), chosen.astype(np.int32), gathered.reshape(-1))
    np.testing.assert_array_equal(gathered.T, rows[chosen, 4:])


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


_load_rows = load_records(WIDTH)


@numba.njit
def _sums(rows, out, ints):
    columns = _load_rows(rows, 0)
    sums = reduce_add_each(columns)
    store(out, 0, sums)
    store(ints, 0, to_int(sums))
    return reduce_add(columns[3]), reduce_max(columns[3])


def test_sums_over_lanes_and_whole_numbers():
    rows = np.random.default_rng(2).integers(-50, 50, (WIDTH, WIDTH)).astype(np.float32)
    out, ints = np.empty(WIDTH, np.float32), np.empty(WIDTH, np.int32)
    assert _sums(rows.reshape(-1), out, ints) == (rows[:, 3].sum(), rows[:, 3].max())
    np.testing.assert_array_equal(out, rows.sum(axis=0))
    np.testing.assert_array_equal(ints, rows.sum(axis=0))


_read2, _read6 = read_row(2), read_row(6)


@numba.njit
def _on_tuples(rows):
    a, b, m = _read2(rows, 1), _read2(rows, 2, 3), _read6(rows, 0)
    write_row(rows, 3, divide(a, b))
    write_row(rows, 3, a, 4)
    return add(a, b), subtract(a, 1.0), multiply(2.0, b), outer(a, b), matrix_vector(m, a)


def test_functions_on_tuples_are_written_out_for_their_lengths():
    rows = np.random.default_rng(5).random((4, 6))
    a, b, m = rows[1, :2].copy(), rows[2, 3:5].copy(), rows[0].reshape(3, 2).copy()
    untouched = rows[3, 2:4].copy()
    expected = a + b, a - 1, 2 * b, np.outer(a, b).reshape(-1), m @ a
    for result, value in zip(_on_tuples(rows), expected, strict=True):
        np.testing.assert_allclose(result, value, rtol=1e-15)
    np.testing.assert_array_equal(rows[3], [*(a / b), *untouched, *a])


@simd_inline
def _double(i, values, doubled):
    store(doubled, i, load(values, i) * 2)


@simd_inline_alloc
def _scratch():
    return (np.empty(WIDTH, np.float32),)


@simd_inline
def _double_through_memory(i, values, doubled, room):
    store(room, 0, load(values, i) * 2)
    store(doubled, i, load(room, 0))


@kernel
def _double_all(values, doubled):
    parallel_for_vectors(_double, len(values), (values, doubled))


@kernel
def _double_all_through_memory(values, doubled):
    parallel_for_vectors(_double_through_memory, len(values), (values, doubled), _scratch)


@pytest.mark.parametrize("double_all", [_double_all, _double_all_through_memory])
@pytest.mark.parametrize("count", [WIDTH, WIDTH + 1, 2500])
def test_loops_over_vectors_reach_every_element_and_no_other(double_all, count):
    values, doubled = np.arange(count, dtype=np.float32), np.full(count + 1, -1, np.float32)
    double_all(values, doubled[:-1])
    np.testing.assert_array_equal(doubled[:-1], 2 * values)
    assert doubled[-1] == -1
