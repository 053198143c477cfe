"""The figure of a sweep: which numbers are drawn where."""

from contextlib import contextmanager
from itertools import product

import numpy as np
import pandas as pd
import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure

from evaluation.figures import sweep_plot
from evaluation.figures.style import MARKERS
from evaluation.figures.sweep_plot import MAX_CURVES, plot_sweep
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.sweep_table import COSTS, PARTS

SHOWN = {"psnr": CATALOGUE["psnr"], "train_cpu_seconds": COSTS["train_cpu_seconds"]}
VARIANTS = ("alternating", "surfhead")


def sweep_rows(keys, choices):
    """Rows with values that no other row has; PSNR alone has intervals."""
    rows = [dict(zip((*keys, "variant"), row, strict=True)) for row in product(*choices, VARIANTS)]
    for number, row in enumerate(rows):
        row |= {f"psnr{part}": value for part, value in zip(PARTS, (number, number - 2, number + 1, 9), strict=True)}
        row |= {"train_cpu_seconds": 1000 + number, "train_cpu_seconds_n": 1}
        row |= {"train_cpu_seconds_low": np.nan, "train_cpu_seconds_high": np.nan}
    return pd.DataFrame(rows)


@pytest.fixture
def draw(monkeypatch, tmp_path):
    """Draw rows, and return the figure without writing it."""
    drawn = []

    @contextmanager
    def keep(file, size, **options):
        drawn.append(Figure(figsize=size, layout="constrained"))
        yield drawn[-1]
        drawn[-1].canvas.draw()

    monkeypatch.setattr(sweep_plot, "png_figure", keep)

    def figure(keys, choices):
        rows = sweep_rows(keys, choices)
        plot_sweep(tmp_path / "sweep.png", rows, keys, SHOWN)
        return rows, drawn[-1]

    return figure


def curves(axes):
    """Places and values of each curve of a panel."""
    return [line.get_data() for line in axes.get_lines() if line.get_marker() in MARKERS]


def intervals(axes):
    """Ends of the bars of each curve that has some."""
    bars = [container for container in axes.containers if isinstance(container, ErrorbarContainer)]
    return [[tuple(segment[:, 1]) for segment in bar.lines[2][0].get_segments()] for bar in bars]


def test_one_key_has_a_panel_per_measure_and_a_curve_per_variant(draw):
    """Values are given in an order that is not theirs."""
    rows, figure = draw(["gamma"], [["0.25", "0.1", "0.2"]])
    psnr, cost = (axes for axes in figure.axes if axes.axison)
    assert (psnr.get_xlabel(), psnr.get_ylabel()) == ("gamma", "PSNR ↑ (dB)") and psnr.get_xscale() == "linear"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [*VARIANTS]
    for axes, name in ((psnr, "psnr"), (cost, "train_cpu_seconds")):
        for variant, (places, values) in zip(VARIANTS, curves(axes), strict=True):
            expected = rows[rows["variant"] == variant].sort_values("gamma")
            assert list(places) == [0.1, 0.2, 0.25] and list(values) == list(expected[name])


def test_bars_are_the_intervals_and_what_has_none_has_no_bar(draw):
    _, figure = draw(["gamma"], [["0.1", "0.2"]])
    psnr, cost = (axes for axes in figure.axes if axes.axison)
    expected = [[(value - 2, value + 1) for value in values] for _, values in curves(psnr)]
    assert intervals(psnr) == expected and intervals(cost) == []


def test_several_keys_have_a_row_per_measure_a_column_per_variant_and_a_curve_per_value(draw):
    rows, figure = draw(["train.iterations", "gamma"], [["10", "1000"], ["0.1", "0.2", "0.25"]])
    assert [axes.get_title() for axes in figure.axes] == [*VARIANTS, "", ""]
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "train.iterations", "train.iterations"]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["gamma=0.1", "gamma=0.2", "gamma=0.25"]
    for axes, (name, variant) in zip(figure.axes, product(SHOWN, VARIANTS), strict=True):
        assert axes.get_xscale() == "log"
        for gamma, (places, values) in zip(("0.1", "0.2", "0.25"), curves(axes), strict=True):
            expected = rows[(rows["variant"] == variant) & (rows["gamma"] == gamma)]
            assert list(places) == [10, 1000] and list(values) == list(expected[name])


def test_values_that_are_no_numbers_are_categories_beside_each_other(draw):
    _, figure = draw(["exaggerate"], [["robust", "paper", "null"]])
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["robust", "paper", "null"]
    (first, *_), (second, *_) = curves(axes)
    assert np.allclose(first - np.arange(3), first[0]) and first[0] < 0 < second[0]
    assert np.all(np.abs([first - np.arange(3), second - np.arange(3)]) < 0.5)
    assert {line.get_linestyle() for line in axes.get_lines() if line.get_marker() in MARKERS} == {"None"}


def test_curves_are_told_apart_without_colour_and_what_is_left_out_is_said(draw):
    _, figure = draw(["train.seed", "gamma"], [["1", "2"], [f"0.{number:02}" for number in range(1, MAX_CURVES + 3)]])
    handles = figure.legends[0].get_lines()
    assert len({(line.get_marker(), line.get_linestyle()) for line in handles}) == len(handles) == MAX_CURVES
    assert figure.legends[0].get_title().get_text().startswith(f"{MAX_CURVES} of {MAX_CURVES + 2} curves")


def test_a_figure_is_written_as_png_and_pdf(tmp_path):
    plot_sweep(tmp_path / "sweep.png", sweep_rows(["gamma"], [["0.1", "0.2"]]), ["gamma"], SHOWN)
    assert (tmp_path / "sweep.png").read_bytes()[:4] == b"\x89PNG" and (tmp_path / "sweep.pdf").read_bytes()[
        :4
    ] == b"%PDF"
