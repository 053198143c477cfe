"""Results of threads in the order of the arguments."""

import threading

import pytest

from carigs.system.in_order import in_order


def test_results_come_in_order_whatever_ends_first():
    second_done = threading.Event()

    def call(number):
        if number == 0:
            assert second_done.wait(30)
        if number == 1:
            second_done.set()
        return number * number

    assert list(in_order(call, range(6), 2)) == [0, 1, 4, 9, 16, 25]


def test_few_arguments_are_taken_ahead():
    taken = []

    def arguments():
        for number in range(100):
            taken.append(number)
            yield number

    results = in_order(lambda number: number, arguments(), 3)
    for number in range(90):
        assert next(results) == number
        assert len(taken) <= number + 5


def test_what_a_call_raises_is_raised_in_its_place():
    results = in_order(lambda number: 1 // (number - 2), range(5), 2)
    assert [next(results), next(results)] == [-1, -1]
    with pytest.raises(ZeroDivisionError):
        next(results)
