"""The lists of surfels of each tile against their definition."""

import numpy as np
import pytest

from carigs.splat.rasterizer.binning import TILE_SIZE, tile_lists

WIDTH, HEIGHT = 3 * TILE_SIZE - 5, 2 * TILE_SIZE + 1  # the last tiles are cut


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("decades", [0.0, 0.5, 2.0, 6.0])
def test_each_tile_lists_the_surfels_that_overlap_it_by_depth(decades, workers):
    """Equal depths in the order of the surfels; culled surfels nowhere; every pair has a slot of its surfel."""
    rng = np.random.default_rng(0)
    n = 400
    depth = (0.01 * 10 ** (decades * rng.random(n))).astype(np.float32)
    depth[n // 2 :] = depth[: n // 2]
    x, y = (np.sort(rng.integers(0, size + 1, (n, 2)), axis=1) for size in (WIDTH, HEIGHT))
    box = np.column_stack([x, y]).astype(np.int32)
    is_culled = (x[:, 0] == x[:, 1]) | (y[:, 0] == y[:, 1]) | (rng.random(n) < 0.1)
    first, stop = box[:, 0::2] // TILE_SIZE, (box[:, 1::2] - 1) // TILE_SIZE + 1
    num_tiles = np.where(is_culled, 0, (stop - first).prod(axis=1)).astype(np.int32)
    lists = tile_lists(depth, box, num_tiles, WIDTH, HEIGHT, workers)
    across, down = -(-WIDTH // TILE_SIZE), -(-HEIGHT // TILE_SIZE)
    by_depth = np.argsort(depth, kind="stable")
    for tile in range(across * down):
        place = np.array([tile % across, tile // across])
        overlaps = ~is_culled & (first <= place).all(axis=1) & (place < stop).all(axis=1)
        found = lists.surfel[lists.start[tile] : lists.start[tile + 1]]
        np.testing.assert_array_equal(found, by_depth[overlaps[by_depth]])
    assert sorted(lists.slot) == list(range(num_tiles.sum()))
    assert (lists.first_slot[lists.surfel] <= lists.slot).all()
    assert (lists.slot < lists.first_slot[lists.surfel + 1]).all()
