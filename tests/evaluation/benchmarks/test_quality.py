"""The benchmark of training to quality: PSNR rises during a run, and budgets bind."""

from dataclasses import replace

import pandas as pd

from carigs.settings import Density, Train
from evaluation.benchmarks.plots import plot_quality
from evaluation.benchmarks.quality import EVALUATIONS, evaluate_runs
from evaluation.benchmarks.synthetic_scenes import capture_images, moving_head

SETTINGS = Train(hair_regions=(), density=Density(start=10, every=10, gradient_threshold=1e-6))


def test_runs_learn_within_their_budgets(tmp_path):
    sequence = moving_head(2)
    capture = capture_images(sequence, tmp_path, 48, 64).capture
    last = max(sequence.parameters)
    frames = (replace(frame, split="test" if frame.timestep == last else "train") for frame in capture.frames)
    capture = replace(capture, frames=tuple(frames))
    table = pd.DataFrame(evaluate_runs(SETTINGS, sequence, capture, (340, 600), (64,)))
    assert len(table) == 2 * EVALUATIONS
    for budget, run in table.groupby("budget"):
        assert run.seconds.is_monotonic_increasing
        assert run.step.iloc[-1] == 64
        assert run.psnr.iloc[-1] > run.psnr.iloc[0] + 3
        assert 320 < run.surfels.iloc[-1] <= budget
    plot_quality(tmp_path / "quality.png", table)
    assert (tmp_path / "quality.png").stat().st_size > 1000
