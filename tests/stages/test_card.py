"""Stage `card`: which jobs count for the costs of its stages."""

from __future__ import annotations

from carigs.runs.job_record import JobCosts
from carigs.stages.card import stage_costs

NAMES = {"anna", "ours", "gamma=0.25", "seed=0", "seed=3"}


def test_costs_are_those_of_the_studys_seeds():
    points = {
        "capture": ["anna", "bert"],
        "gtstar": ["anna,gamma=0.25,ours,level=0.25", "anna,gamma=0.5,ours,level=0.25"],
        "train": [f"anna,gamma=0.25,ours,seed={seed}" for seed in (0, 3, 4)] + ["anna,gamma=0.25,ours"],
        "render": [f"anna,gamma=0.25,ours{rest}" for rest in (",seed=3", "", ",seed=3,level=0.1")],
    }
    costs = {(stage, point): JobCosts(1.0, 1.0, None) for stage, some in points.items() for point in some}
    counts = {value.region: value.n for value in stage_costs(costs, NAMES) if value.measure == "stage_seconds"}
    assert counts == {"capture": 1, "gtstar": 1, "train": 2, "render": 1}
