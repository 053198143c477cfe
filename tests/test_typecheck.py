"""The shapes in signatures are really checked: a test suite that checks nothing looks just as green."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from carigs.capture import look_at


def test_a_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError):
        look_at(np.zeros(2), np.zeros(3))
