"""The page of the trade-offs, from records that are made up."""

import re

import pandas as pd
import pytest

from carigs.errors import InputError
from carigs.light.fitting import DIRECTIONS
from evaluation.benchmarks.training_trade_offs import list_cases
from evaluation.trade_offs import page
from evaluation.trade_offs.curve import BELOW
from evaluation.trade_offs.engine import describe_engine
from evaluation.trade_offs.knobs import knobs

COLUMNS = ["case", "quantity", "unit", "value", "reference"]
HEAT = "the first, heat 0.5 %"


def surface_rows():
    for number, vertices in enumerate((100, 400)):
        for name, seconds, error in ((HEAT, 0.2, 0.01 / (1 + number)), ("quadric fit (libigl)", 2.0, 0.5)):
            yield f"ellipsoid, {vertices} vertices", f"CPU: K: {name}", "s", seconds
            yield f"ellipsoid, {vertices} vertices", f"error of K: {name}", "1", error
    for nodes, seconds, error in ((2, 0.1, 4e-3), (3, 0.15, 1.6e-4), (4, 0.2, 9e-6), (8, 0.4, 1e-9)):
        for head in ("other", "typical"):
            yield head, f"largest error of a path of {nodes} nodes", "diagonal", error
            yield head, f"CPU: solve a path of {nodes} nodes", "s", seconds
    for head in ("other", "typical"):
        yield head, "nodes of the default path", "1", 4.0
    yield "typical, robust", "rms error of the blend at level 0.1250", "diagonal", 1e-3
    for solver, seconds, residual in (("LU, ours", 0.1, 1e-15), ("conjugate gradients", 1.0, 1e-12)):
        for vertices in (500, 2000):
            yield f"{vertices} vertices, {solver}", "one level", "s", seconds * vertices
            yield f"{vertices} vertices, {solver}", "relative residual of one level", "1", residual


def target_rows():
    for warp, samples in ((w, n) for w in ("affine", "perspective") for n in (1, 2, 4, 8)):
        case = f"{warp}, {samples}x{samples}"
        yield case, "visibility, warp and masks", "ms", 20.0 + samples
        yield case, "99th percentile of the error", "1", 0.2 / samples
    yield "level 0.25, new light", "PSNR of trusted skin", "dB", 33.0
    for count in (DIRECTIONS // 2, DIRECTIONS, 2 * DIRECTIONS):
        yield f"{count} light directions", "CPU: fit of the light", "s", count / 64
        yield f"{count} light directions", "CPU: transfers of a timestep", "s", count / 640
        for region in ("skin", "face"):
            yield f"{count} light directions", f"PSNR of trusted {region}", "dB", 33.0


def training_rows(gain=3.0):
    for case in list_cases():
        slow = "6000" in case or "best" in case
        yield case, "training", "CPU s", 200.0 if slow else 100.0
        yield case, "surfels", "1", 18774.0
        for level in ("0", "gamma"):
            for region in ("full", "head", "face"):
                yield case, f"PSNR at level {level}, {region}", "dB", 30.0 + gain * slow


def splat_rows():
    """With references: 4 times as fast in ms, 5 times in steps per second."""
    yield "50 surfels", "forward", "ms", 2.5, 10.0
    yield "50 surfels", "training step", "1/s", 20.0, 4.0
    yield "64x64, 2 threads", "L1 + SSIM", "ms", 1.0, 21.0
    yield "50 surfels", "contributing pairs", "1", 1e6, None
    yield "start, nothing cached", "import", "s", 0.33, None


@pytest.fixture
def tables():
    rows = {"surface": surface_rows(), "target": target_rows(), "training": training_rows()}
    made = {name: pd.DataFrame([(*row, None) for row in found], columns=COLUMNS) for name, found in rows.items()}
    return {**made, "splat": pd.DataFrame(splat_rows(), columns=COLUMNS)}


def test_the_engine_is_told_by_ratios_first(tables):
    lines = "\n".join(describe_engine(tables["splat"])).splitlines()
    cells = {name: rest for name, *rest in ([c.strip() for c in line.strip("|").split("|")] for line in lines)}
    assert cells["50 surfels: forward"] == ["4.0", "2.5 ms", "10 ms", "plain loops"]
    assert cells["50 surfels: training step"] == ["5.0", "20 per second", "4 per second", "plain loops"]
    assert cells["64x64, 2 threads: L1 + SSIM"] == ["21.0", "1 ms", "21 ms", "PyTorch"]
    assert cells["start, nothing cached: import"] == ["0.33 s"]
    assert "contributing pairs" not in "".join(lines)


def described(tables, setting):
    knob = next(knob for knob in knobs() if knob.setting == setting)
    return "\n".join(page.describe_knob(knob, knob.read(tables)))


@pytest.mark.slow
def test_the_page_has_every_setting_with_its_default_and_its_figures(tables, tmp_path):
    page.write_page(tmp_path / "benchmarks.md", tables)
    text = (tmp_path / "benchmarks.md").read_text("utf-8")
    for knob in knobs():
        assert f"### `{knob.setting}`" in text
    assert text.count("(default)") == len(list(knobs()))
    for image in re.findall(r"\]\((images/.*?)\)", text):
        for suffix in (".png", ".pdf"):
            assert (tmp_path / image).with_suffix(suffix).stat().st_size > 1000
    assert text.count("](images/") == 3
    for preset in page.PRESETS:
        assert re.search(rf"\| {preset} \| [12]00 \| 18774 \| 3[03]\.00 ", text)


def test_only_the_typical_head_and_the_finest_surface_are_shown(tables):
    assert described(tables, "exaggerate.path_nodes").count("| 4 (default) ") == 1
    curvature = described(tables, "exaggerate.curvature_smoothing")
    assert "0.005" in curvature and "0.01 " not in curvature


def test_a_default_on_the_knee_needs_no_reason(tables):
    text = described(tables, "exaggerate.path_nodes")
    assert "the default 4 is on the knee" in text and "Why" not in text
    assert "The next faster one, 3, takes 0.75 times as long and loses 4.08 dB" in text  # 20 log10 of 1.6


def test_a_reason_is_printed_only_where_the_data_say_so(tables):
    knob = next(knob for knob in knobs() if knob.setting == "train.iterations")
    text = described(tables, "train.iterations")
    assert re.search(r"the default \d+ is below the knee \(the least is at 6000\)", text)
    assert f"Why {BELOW}: {knob.reasons[BELOW]}" in text
    assert "takes 2.00 times as long and gains 3.00 dB" in text
    rows = [(*row, None) for row in training_rows(gain=0.1)]
    without = {"training": pd.DataFrame(rows, columns=COLUMNS)}
    assert "Why" not in described(without, "train.sh_degree")


def test_a_default_off_the_knee_without_a_reason_is_said(tables):
    target = tables["target"]
    target.loc[target.case.str.startswith("perspective, 8x8") & (target.unit == "1"), "value"] = 1e-3
    assert "Why below the knee: no reason is on record; reconsider the default." in described(
        tables, "gtstar.supersampling"
    )


def test_a_default_that_was_not_measured_is_named_with_its_file(tables):
    tables["target"] = tables["target"][~tables["target"].case.str.startswith("perspective, 4x4")]
    with pytest.raises(InputError, match=r"target\.csv: gtstar\.supersampling: the default 4 .*measured: 1, 2, 8"):
        described(tables, "gtstar.supersampling")


def test_a_default_alone_is_no_curve_and_nothing_is_written(tables, tmp_path):
    tables["training"] = tables["training"][~tables["training"].case.str.startswith("capture.toy")]
    with pytest.raises(InputError, match=r"training\.csv: capture\.toy.*only the default 208x272 was measured"):
        page.write_page(tmp_path / "benchmarks.md", tables)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("knob", list(knobs()), ids=lambda knob: knob.setting)
def test_records_of_another_version_are_named(knob, tables):
    """A file that is complete but for the times, or empty."""
    table = tables[knob.table]
    times = table.quantity.str.contains("CPU|training|one level$|visibility, warp")
    for kept in (table[~times], table[:0]):
        with pytest.raises(InputError, match=rf"{knob.table}\.csv: {knob.setting}: "):
            knob.read({knob.table: kept})


def test_records_that_are_no_benchmark_are_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv"):
        page.read_tables([tmp_path / "none.csv"])
    (tmp_path / "rows.csv").write_text("case,value\na,1\n")
    with pytest.raises(InputError, match=r"rows\.csv.*case, quantity, unit, value, reference"):
        page.read_tables([tmp_path / "rows.csv"])
