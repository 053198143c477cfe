"""Fields of regions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.mesh.regions import partition_of_unity


@settings(max_examples=20)
@given(st.integers(0, 2**31))
def test_overlapping_fields_are_scaled_to_a_partition_of_unity(seed):
    random = np.random.default_rng(seed)
    fields = random.random((3, 50)) * (random.random((3, 50)) < 0.6)
    shared = partition_of_unity(fields)
    assert shared.sum(axis=0).max() <= 1 + 1e-12
    alone = fields.sum(axis=0) <= 1
    np.testing.assert_array_equal(shared[:, alone], fields[:, alone])
