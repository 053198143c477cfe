"""The shapes in signatures are really checked: a test suite that checks nothing looks just as green."""

from __future__ import annotations

import math

import numpy as np
import pytest
import typecheck
from jaxtyping import Float64, TypeCheckError

from carigs.capture import look_at


def test_a_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError):
        look_at(np.zeros(2), np.zeros(3))


@pytest.fixture
def check(monkeypatch):
    """Checks all calls, as in `make test-more`."""
    monkeypatch.setattr(typecheck, "CHECKED_CALLS", math.inf)
    return typecheck.check


def test_shapes_that_have_passed_let_no_others_pass(check):
    @check
    def product(a: Float64[np.ndarray, "n m"], b: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, " n"]:
        return a @ b

    for _ in range(3):
        np.testing.assert_array_equal(product(np.ones((4, 3)), np.ones(3)), 3)
        np.testing.assert_array_equal(product(np.ones((4, 3)), b=np.ones(3)), 3)
        for a, b in ((np.ones((4, 3)), np.ones((3, 3))), (np.ones((4, 3), np.float32), np.ones(3)), ([[1.0]], [1.0])):
            with pytest.raises(TypeCheckError):
                product(a, b)


def test_each_shape_of_a_result_is_checked_against_the_arguments(check):
    @check
    def first(values: Float64[np.ndarray, " n"], count: int) -> Float64[np.ndarray, " n"]:
        return values[:count] if count else np.float32([1])

    @check
    def some(values: Float64[np.ndarray, " n"], count: int = 1) -> Float64[np.ndarray, " k"]:
        return values[:count]

    for _ in range(3):
        assert len(first(np.ones(4), 4)) == 4
        for count in (3, 0):
            with pytest.raises(TypeCheckError):
                first(np.ones(4), count)
        assert [len(some(np.ones(4))), len(some(np.ones(4), 2)), len(some(np.ones(4), count=3))] == [1, 2, 3]


def test_a_dimension_that_a_value_states_is_checked_in_every_call(check):
    @check
    def repeated(count: int) -> Float64[np.ndarray, " {count}"]:
        return np.ones(min(count, 2))

    assert len(repeated(2)) == 2
    with pytest.raises(TypeCheckError):
        repeated(3)


def test_a_function_is_called_once_whether_its_shapes_are_known_or_not(check):
    calls = []

    @check
    def noted(values: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " k"]:
        calls.append(values)
        return values[: len(calls)]

    for i in range(1, 4):
        assert len(noted(np.ones(4))) == i == len(calls)
