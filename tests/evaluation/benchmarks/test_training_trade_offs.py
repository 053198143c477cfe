"""The benchmark of trainings: every case composes, and a tiny one measures what it says."""

import pytest

from evaluation.benchmarks import training_trade_offs
from evaluation.benchmarks.training_trade_offs import SERIES, case_settings, list_cases, measure

TINY = [
    *(f"capture.toy.{name}" for name in ("width=52", "height=68", "cameras=2", "steps_per_sequence=1")),
    *(f"capture.toy.{name}" for name in ("supersampling=1", "texture_size=128", "hair_strands=50")),
    "train.iterations=4",
]


@pytest.mark.slow
def test_every_case_of_a_series_is_another_training():
    """None repeats the defaults, which are the preset `balanced`."""
    found = {case: repr(case_settings(case)) for case in list_cases()}
    assert found["preset=balanced"] == repr(case_settings(""))
    assert len({found[case] for case in ("preset=balanced", *SERIES)}) == 1 + len(SERIES)
    assert len({found[f"preset={name}"] for name in ("fast", "balanced", "best")}) == 3


@pytest.mark.slow
def test_equal_settings_are_trained_once_and_more_steps_are_better(tmp_path, monkeypatch):
    trained, train = [], training_trade_offs.train_avatar

    def counted(inputs, settings):
        trained.append(settings.iterations)
        return train(inputs, settings)

    monkeypatch.setattr(training_trade_offs, "train_avatar", counted)
    cases = ["preset=balanced", "train.iterations=4", "train.iterations=60", "capture.toy.width=39"]
    rows = list(measure(cases, tmp_path, *TINY))
    assert trained == [8, 4, 8, 60, 8, 4]  # each after its warm-up; the second case is the first
    values = {(row.case, row.quantity): row.value for row in rows}
    assert len(values) == len(rows)
    assert {row.quantity for row in rows if row.case == cases[0]} == {row.quantity for row in rows}
    for quantity in ("training", "surfels", "PSNR at level 0, head", "PSNR at level gamma, head"):
        assert values[cases[0], quantity] == values[cases[1], quantity] > 0
        if quantity != "surfels":
            assert values[cases[2], quantity] > values[cases[1], quantity]
    assert len(list(tmp_path.iterdir())) == 2  # captures of two widths
