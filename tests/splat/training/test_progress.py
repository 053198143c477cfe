"""Lines of progress where stderr is no terminal."""

import re

import pytest

from carigs.splat.training import progress as module
from carigs.splat.training.progress import RecentRate, progress


@pytest.fixture
def clock(monkeypatch):
    """A clock that tests set."""
    now = [100.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    return now


def test_the_time_left_is_that_of_the_steps_after_the_first(clock, capsys):
    """A first step of 60 s, in which kernels are compiled, says nothing of the others: 10 a second."""
    with progress("train", 1000) as report:
        for step in range(1, 1001):
            clock[0] += 60.0 if step == 1 else 0.1
            report(step, loss=0.5)
    first, *others, last = capsys.readouterr().err.splitlines()
    assert first == "train 1/1000  loss 0.5"
    for line in others:
        step, rate, left = re.fullmatch(r"train (\d+)/1000  (10\.0) it/s  loss 0\.5  (\d+) s left", line).groups()
        assert float(rate) * float(left) == pytest.approx(1000 - int(step), abs=10)
    assert len(others) >= 8 and last == "train 1000/1000  10.0 it/s  loss 0.5"


def test_a_run_that_is_resumed_counts_its_own_steps_only(clock, capsys):
    with progress("train", 10_000, done=9000, every_seconds=0.0) as report:
        for step in range(9001, 9101):
            clock[0] += 0.1
            report(step)
    assert "train 9100/10000  10.0 it/s  90 s left" in capsys.readouterr().err.splitlines()


def test_a_short_loop_has_no_rate(clock, capsys):
    with progress("train", 3) as report:
        for step in (1, 2, 3):
            clock[0] += 0.1
            report(step, loss=1.0)
    assert capsys.readouterr().err == "train 3/3  loss 1\n"


@pytest.mark.parametrize("later", [0.05, 0.2], ids=["faster", "slower"])
def test_the_time_left_follows_steps_that_become_faster_or_slower(later, clock, capsys):
    """The first fortieth of the steps takes 0.1 s each, the others another time: within 20 % after a tenth of them."""
    with progress("train", 4000, every_seconds=0.0) as report:
        for step in range(1, 4001):
            clock[0] += 0.1 if step <= 100 else later
            report(step)
    lines = capsys.readouterr().err.splitlines()
    left = float(re.fullmatch(r"train 400/4000  [\d.]+ it/s  (\d+) s left", lines[399]).group(1))
    assert left == pytest.approx(3600 * later, rel=0.2)


def test_few_times_are_kept():
    rate = RecentRate()
    for step in range(100_000):
        rate.add(step * 0.01, step)
    assert len(rate._kept) < 2100  # 500 s at four a second
