"""From rows to tables: means, pairing, stability of bytes, errors in one line."""

import csv

import numpy as np
import pytest

from carigs.errors import CarigsError, InputError
from carigs.settings import Tabulate
from carigs.stages.tabulate import tabulate
from evaluation.tables.rows import Row, Scene, read_rows, row, write_rows
from evaluation.tables.table import summarise

SETTINGS = Tabulate(resamples=200)


def study_rows(variants=("alternating", "surfhead"), levels=(0.0, 0.25)) -> list[Row]:
    """A variant's PSNR is that of its frame (wide spread) plus a constant gain (none)."""
    generator = np.random.default_rng(0)
    frames = {(c, t): generator.normal(30, 5) for c in range(4) for t in range(3)}
    rows = []
    for variant in variants:
        for level in levels:
            scene = Scene("toy", "toy", variant, 0.25, level)
            gain = 1.5 if variant == "alternating" else 0.0
            for region in ("full", "hair"):
                rows += [row(scene, "test", frame, region, "psnr", value + gain) for frame, value in frames.items()]
            rows.append(row(scene, "test", (None, None), "full", "clip_d", None, "no weights | in a_folder"))
    return rows


def paths(tmp_path, name="out"):
    return {key: tmp_path / f"{name}.{end}" for key, end in (("table", "csv"), ("markdown", "md"), ("latex", "tex"))}


def test_means_are_means_of_frames():
    rows = study_rows()
    wanted = np.mean([r.value for r in rows if (r.variant, r.level, r.region) == ("surfhead", 0.25, "hair")])
    (found,) = [
        s for s in summarise(rows, SETTINGS)
        if (s.variant, s.minus, s.level, s.region, s.metric) == ("surfhead", "", 0.25, "hair", "psnr")
    ]  # fmt: skip
    assert found.mean == pytest.approx(wanted) and found.n == 12 and found.low < wanted < found.high


def test_a_difference_that_is_the_same_in_every_frame_has_no_uncertainty():
    # Unpaired, the frames' own spread (5 dB) would drown the 1.5 dB.
    differences = [s for s in summarise(study_rows(), SETTINGS) if s.minus == "surfhead" and s.metric == "psnr"]
    assert len(differences) == 4
    for found in differences:
        assert (found.variant, found.n) == ("alternating", 12)
        assert (found.mean, found.low, found.high) == pytest.approx((1.5, 1.5, 1.5), abs=1e-9)


def test_only_frames_of_both_variants_are_paired():
    rows = [r for r in study_rows() if (r.variant, r.camera) != ("surfhead", 0)]
    (found,) = [s for s in summarise(rows, SETTINGS) if s.minus and (s.level, s.region) == (0.25, "full")]
    assert found.n == 9 and found.mean == pytest.approx(1.5)


def test_nothing_measured_keeps_the_reason():
    (found,) = [s for s in summarise(study_rows(["surfhead"], [0.25]), SETTINGS) if s.metric == "clip_d"]
    assert (found.mean, found.n, found.nulls, found.reason) == (None, 0, 1, "no weights | in a_folder")


def test_tables_do_not_depend_on_the_order_of_rows_and_files(tmp_path):
    rows = study_rows()
    shuffled = [rows[i] for i in np.random.default_rng(0).permutation(len(rows))]
    for name, order in (("a", rows), ("b", shuffled)):
        half = len(order) // 2
        files = [tmp_path / f"{name}{i}.csv" for i in range(2)]
        write_rows(files[0], order[:half])
        write_rows(files[1], order[half:])
        tabulate(SETTINGS, rows=files[:: 1 if name == "a" else -1], **paths(tmp_path, f"out_{name}"))
    for a, b in zip(paths(tmp_path, "out_a").values(), paths(tmp_path, "out_b").values(), strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_the_readable_tables_are_well_formed_and_tell_the_reason(tmp_path):
    write_rows(tmp_path / "rows.csv", study_rows())
    tabulate(SETTINGS, rows=[tmp_path / "rows.csv"], **paths(tmp_path))
    markdown, latex = ((tmp_path / f"out.{end}").read_text() for end in ("md", "tex"))
    widths = [line.count("|") for line in markdown.splitlines() if line.startswith("|")]
    assert set(widths) == {9, 4, 3}  # variant + 7 metrics; region + 2 variants; region + 1 difference
    assert "no weights | in a_folder" in markdown and r"no weights | in a\_folder" in latex
    assert "+1.50 [+1.50, +1.50]" in markdown and "+1.50 [+1.50, +1.50]" in latex
    assert latex.count(r"\begin{tabular}") == latex.count(r"\end{tabular}") == 4
    for line in latex.splitlines():
        if line.endswith(r" \\"):
            assert line.count(" & ") in (7, 2, 1)


def test_the_csv_holds_every_summary(tmp_path):
    write_rows(tmp_path / "rows.csv", study_rows())
    tabulate(SETTINGS, rows=[tmp_path / "rows.csv"], **paths(tmp_path))
    with (tmp_path / "out.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert len(lines) == 2 * 2 * 3 + 2 * 2
    assert {line["mean"] for line in lines if line["metric"] == "clip_d"} == {""}


def test_rows_survive_the_disk(tmp_path):
    rows = study_rows()
    write_rows(tmp_path / "rows.csv", rows)
    for written, found in zip(rows, read_rows(tmp_path / "rows.csv"), strict=True):
        assert found._replace(value=None) == written._replace(value=None)
        assert found.value == (None if written.value is None else pytest.approx(written.value, rel=1e-8))


def test_an_infinite_value_becomes_null_with_a_reason():
    found = row(Scene("a", "b", "c", 0.25, 0.0), "test", (0, 0), "full", "psnr", float("inf"))
    assert found.value is None and "infinite" in found.reason


def test_the_same_measurement_twice_is_an_error():
    rows = study_rows(["surfhead"], [0.0])
    with pytest.raises(CarigsError, match=r"surfhead.*psnr of full is given twice.*camera 0"):
        summarise([*rows, rows[0]], SETTINGS)


GOOD = "toy,toy,surfhead,0.25,0,test,1,2,full,psnr,30.5,"


@pytest.mark.parametrize(
    ("line", "field"),
    [
        (GOOD.replace("30.5", "many"), "line 2, value"),
        (GOOD.replace("30.5", "nan"), "line 2, value"),
        (GOOD.replace("30.5", ""), "line 2, value"),
        (GOOD.replace("0.25", "x"), "line 2, gamma"),
        (GOOD.replace(",1,", ",1.5,"), "line 2, camera"),
        (GOOD + ",", "line 2"),
        ("toy", "line 2"),
    ],
)
def test_a_malformed_row_names_its_file_and_line(tmp_path, line, field):
    file = tmp_path / "rows.csv"
    file.write_text(",".join(Row._fields) + "\n" + line + "\n")
    with pytest.raises(InputError) as caught:
        read_rows(file)
    assert caught.value.field == field and str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_a_wrong_header_or_a_missing_file_is_an_input_error(tmp_path):
    (tmp_path / "rows.csv").write_text("a,b\n")
    with pytest.raises(InputError, match="expected the columns study, subject"):
        read_rows(tmp_path / "rows.csv")
    with pytest.raises(InputError, match="no such file"):
        read_rows(tmp_path / "none.csv")
