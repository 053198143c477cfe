"""The shapes in signatures are really checked: a test suite that checks nothing looks just as green."""

from __future__ import annotations

import numpy as np
import pytest
import typecheck
from jaxtyping import Float, TypeCheckError

from carigs.capture import look_at


def test_a_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError):
        look_at(np.zeros(2), np.zeros(3))


@pytest.mark.parametrize(("every", "later"), [(0, []), (20, [*range(69, 200, 20)])])
def test_the_first_calls_in_a_test_are_checked_and_some_later_ones(monkeypatch, every, later):
    monkeypatch.setattr(typecheck, "CHECKED_CALLS", 50)
    monkeypatch.setattr(typecheck, "CHECKED_EVERY", every)
    function = typecheck.check(_takes_pairs)

    def refused() -> list[int]:
        found = []
        for call in range(200):
            try:
                function(np.zeros(3))
            except TypeCheckError:
                found.append(call)
        return found

    assert refused() == [*range(50), *later]
    typecheck.begin_test()
    assert refused() == [*range(50), *later]


def _takes_pairs(pair: Float[np.ndarray, "2"]) -> None:
    pass
