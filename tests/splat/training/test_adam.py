"""Adam against PyTorch's."""

import numpy as np
import pytest
import torch

from carigs.splat.surfels.surfels import flat_discs
from carigs.splat.training.adam import Adam


def test_adam_agrees_with_pytorch():
    rng = np.random.default_rng(0)
    surfels = flat_discs(np.arange(40), rng.normal(size=(40, 3)), np.ones(40), 0.5, rng.random((40, 3)))
    leaves = {name: value.detach().clone().requires_grad_(True) for name, value in surfels.attributes()}
    rates = {name: 0.01 * (i + 1) for i, name in enumerate(leaves)}
    theirs = torch.optim.Adam([{"params": [leaf], "lr": rates[name]} for name, leaf in leaves.items()], eps=1e-15)
    ours = Adam(surfels)
    for _ in range(12):
        for name, value in surfels.attributes():
            value.grad = torch.from_numpy(rng.normal(size=tuple(value.shape)).astype(np.float32))
            leaves[name].grad = value.grad.clone()
        ours.step(surfels, rates)
        theirs.step()
    for name, value in surfels.attributes():
        np.testing.assert_allclose(value.detach(), leaves[name].detach(), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.9, 1.0])
@pytest.mark.parametrize("count", [1, 5, 2500])
def test_frozen_rows_keep_their_values_and_change_no_other_row(count, share):
    rng = np.random.default_rng([count, int(10 * share)])
    frozen, position = rng.random(count) < share, rng.normal(size=(count, 3))
    some, every = (flat_discs(np.arange(count), position, np.ones(count), 0.5, position, 2) for _ in range(2))
    before = [value.detach().clone() for _, value in some.attributes()]
    optimisers = Adam(some), Adam(every)
    rates = {name: 0.01 for name, _ in some.attributes()}
    for _ in range(3):
        for (_, a), (_, b) in zip(some.attributes(), every.attributes(), strict=True):
            a.grad = torch.from_numpy(rng.normal(size=tuple(a.shape)).astype(np.float32))
            b.grad = a.grad.clone()
        optimisers[0].step(some, rates, frozen)
        optimisers[1].step(every, rates)
    for (name, a), (_, b), first in zip(some.attributes(), every.attributes(), before, strict=True):
        assert torch.equal(a[frozen], first[frozen]), name
        assert torch.equal(a[~frozen], b[~frozen]), name
        assert frozen.all() or (a[~frozen] != first[~frozen]).any()
        assert not optimisers[0].first[name][frozen].any()
        assert not optimisers[0].second[name][frozen].any()
