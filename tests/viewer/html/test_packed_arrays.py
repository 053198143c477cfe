"""Arrays for the page: what is packed comes back, up to the step that it is rounded to."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from viewer.html.unpacking import unpacked

from carigs.viewer.html.low_rank import low_rank
from carigs.viewer.html.packed_arrays import deflated, pack_exact, pack_integers, pack_steps
from carigs.viewer.html.surfel_arrays import smallest_three

SHAPES = [(0,), (1,), (7,), (5, 3), (0, 4), (6, 0)]


def round_trip(*arrays) -> dict[str, np.ndarray]:
    return unpacked(*deflated(arrays))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("delta", [False, True])
@pytest.mark.parametrize("low", [0, -1])
@pytest.mark.parametrize("largest", [1, 300, 70_000, 500_000_000])
def test_whole_numbers_come_back(shape, delta, low, largest):
    numbers = np.random.default_rng(0).integers(low * largest, largest + 1, shape)
    back = round_trip(pack_integers("a", numbers, delta=delta))["a"]
    np.testing.assert_array_equal(back, numbers.reshape(back.shape))


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=30), st.floats(1e-3, 10))
def test_numbers_come_back_to_half_a_step(numbers, step):
    back = round_trip(pack_steps("a", np.array(numbers), step))["a"][:, 0]
    assert np.abs(back - numbers).max() <= step / 2 * (1 + 1e-9) + 1e-12


def test_exact_numbers_are_those_of_float32():
    numbers = np.random.default_rng(0).normal(size=(9, 2)) * 10.0 ** np.arange(-4, 5)[:, None]
    np.testing.assert_array_equal(round_trip(pack_exact("a", numbers))["a"], numbers.astype(np.float32))


def test_arrays_lie_one_behind_the_other():
    layouts, content = deflated([pack_integers("a", np.arange(300)), pack_exact("b", np.ones((4, 2)))])
    assert [layout["name"] for layout in layouts] == ["a", "b"]
    assert len(zlib.decompress(content)) == 300 * 2 + 4 * 2 * 4


@pytest.mark.parametrize("rank", [1, 3, 6])
def test_rows_of_low_rank_are_found_as_such(rank):
    """Sums of `rank` rows need no more, and rounding errs by half a step for each."""
    rng, step = np.random.default_rng(rank), 1e-4
    rows = rng.normal(size=(20, rank)) @ rng.normal(size=(rank, 90))
    found = low_rank(rows, 1e-9, step)
    assert found.basis.shape == (rank, 90)
    assert np.abs(found.coefficients @ found.basis - rows).max() <= rank * step / 2 * 1.001


def test_the_tolerance_bounds_the_error():
    rows = np.random.default_rng(0).normal(size=(12, 200)) * np.geomspace(1, 1e-4, 12)[:, None]
    counts = []
    for tolerance in (1e-1, 1e-2, 1e-3):
        found = low_rank(rows, tolerance, 1e-6)
        error = np.sqrt(np.mean((found.coefficients @ found.basis - rows) ** 2))
        counts.append(found.basis.shape[0])
        assert error <= tolerance + 1e-5
    assert counts == sorted(set(counts)) and counts[-1] < 12


def test_rows_without_content_need_nothing():
    assert low_rank(np.zeros((3, 10)), 1e-6, 1e-6).basis.shape == (0, 10)


def test_three_components_determine_a_rotation():
    quaternions = np.random.default_rng(0).normal(size=(200, 4)) * np.geomspace(1e-6, 1e6, 200)[:, None]
    largest, others = smallest_three(quaternions)
    whole = np.empty((200, 4))
    missing = np.arange(4)[None] == largest[:, None]
    whole[~missing] = others.ravel()
    whole[missing] = np.sqrt(1 - (others**2).sum(axis=1))
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((whole * unit).sum(axis=1)), 1, atol=1e-12)
    assert np.abs(others).max() <= np.sqrt(0.5) + 1e-12
