"""From metric records to tables: means, pairing, stability of bytes, errors in one line."""

import csv
from itertools import product

import numpy as np
import pandas as pd
import pytest

from carigs.errors import CarigsError, InputError
from carigs.settings import Tabulate
from carigs.stages.tabulate import tabulate
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record, write_metrics
from evaluation.tables.summary import read_metrics, summarise

SETTINGS = Tabulate()


def study_records(variants=("alternating", "surfhead"), levels=(0.0, 0.25), seeds=(0,)) -> list[MetricRecord]:
    """A variant's PSNR is that of its frame and training (wide spread) plus a constant gain (none)."""
    generator = np.random.default_rng(0)
    frames = {(c, t): generator.normal(30, 5) for c in range(4) for t in range(3)}
    records = []
    for variant, seed in product(variants, seeds):
        for level in levels:
            point = StudyPoint("toy", "toy", variant, seed, 0.25, level, "EXP-2")
            gain = 7.0 * seed + (1.5 if variant == "alternating" else 0.0)
            for region in ("full", "hair"):
                records += [
                    metric_record(point, "test", frame, region, "psnr", value + gain) for frame, value in frames.items()
                ]
            records.append(
                metric_record(point, "test", (None, None), "full", "clip_d", None, "no weights | in a_folder")
            )
    return records


def summaries(records):
    return list(summarise(pd.DataFrame(records), SETTINGS, CATALOGUE).itertuples())


def paths(tmp_path, name="out"):
    return {key: tmp_path / f"{name}.{end}" for key, end in (("table", "csv"), ("markdown", "md"), ("latex", "tex"))}


def test_means_are_means_of_frames():
    records = study_records()
    expected = np.mean([r.value for r in records if (r.variant, r.level, r.region) == ("surfhead", 0.25, "hair")])
    (summary,) = [
        s for s in summaries(records)
        if (s.variant, s.minus, s.level, s.region, s.metric) == ("surfhead", "", 0.25, "hair", "psnr")
    ]  # fmt: skip
    assert summary.mean == pytest.approx(expected) and summary.n == 12 and summary.low < expected < summary.high


def test_a_difference_that_is_the_same_in_every_frame_has_no_uncertainty():
    # Unpaired, the frames' own spread (5 dB) would drown the 1.5 dB.
    differences = [s for s in summaries(study_records()) if s.minus == "surfhead" and s.metric == "psnr"]
    assert len(differences) == 4
    for summary in differences:
        assert (summary.variant, summary.n) == ("alternating", 12)
        assert (summary.mean, summary.low, summary.high) == pytest.approx((1.5, 1.5, 1.5), abs=1e-9)


def test_differences_pair_a_seed_with_itself():
    """Trainings of different seeds are 7 dB apart."""
    differences = [s for s in summaries(study_records(seeds=(0, 4))) if s.minus == "surfhead" and s.metric == "psnr"]
    assert len(differences) == 4
    for summary in differences:
        assert (summary.n, summary.seeds) == (24, 2)
        assert (summary.mean, summary.low, summary.high) == pytest.approx((1.5, 1.5, 1.5), abs=1e-9)


def test_only_trainings_of_both_variants_are_paired():
    records = [r for r in study_records(seeds=(0, 4)) if (r.variant, r.seed) != ("surfhead", 4)]
    (summary,) = [s for s in summaries(records) if s.minus and (s.level, s.region) == (0.25, "full")]
    assert (summary.n, summary.seeds) == (12, 1) and summary.mean == pytest.approx(1.5)


def test_the_mean_over_seeds_is_the_mean_of_their_means():
    both, *each = (
        [s for s in summaries(study_records(seeds=seeds)) if s.metric == "psnr" and not s.minus]
        for seeds in ((0, 4), (0,), (4,))
    )
    assert len(both) == 8
    for mean, first, second in zip(both, *each, strict=True):
        assert mean.mean == pytest.approx((first.mean + second.mean) / 2)
        assert mean.high - mean.low > first.high - first.low  # one more factor


def test_only_frames_of_both_variants_are_paired():
    records = [r for r in study_records() if (r.variant, r.camera) != ("surfhead", 0)]
    (summary,) = [s for s in summaries(records) if s.minus and (s.level, s.region) == (0.25, "full")]
    assert summary.n == 9 and summary.mean == pytest.approx(1.5)


def test_nothing_measured_keeps_the_reason():
    (summary,) = [s for s in summaries(study_records(["surfhead"], [0.25])) if s.metric == "clip_d"]
    assert np.isnan(summary.mean)
    assert (summary.n, summary.nulls, summary.reason) == (0, 1, "no weights | in a_folder")


def test_tables_do_not_depend_on_the_order_of_records_and_files(tmp_path):
    records = study_records()
    shuffled = [records[i] for i in np.random.default_rng(0).permutation(len(records))]
    for name, order in (("a", records), ("b", shuffled)):
        half = len(order) // 2
        files = [tmp_path / f"{name}{i}.csv" for i in range(2)]
        write_metrics(files[0], order[:half])
        write_metrics(files[1], order[half:])
        tabulate(SETTINGS, records=files[:: 1 if name == "a" else -1], **paths(tmp_path, f"out_{name}"))
    for a, b in zip(paths(tmp_path, "out_a").values(), paths(tmp_path, "out_b").values(), strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_the_readable_tables_are_well_formed_and_tell_the_reason(tmp_path):
    write_metrics(tmp_path / "rows.csv", study_records())
    tabulate(SETTINGS, records=[tmp_path / "rows.csv"], **paths(tmp_path))
    markdown, latex = ((tmp_path / f"out.{end}").read_text() for end in ("md", "tex"))
    for table in markdown.split("### ")[1:]:
        assert len({line.count("|") for line in table.splitlines() if line.startswith("|")}) == 1
    for table in latex.split(r"\begin{tabular}")[1:]:
        columns = table.split("\n")[0].count("c")
        lines = [line for line in table.splitlines() if line.endswith(r" \\") and "multicolumn" not in line]
        assert lines and {line.count(" & ") for line in lines} == {columns}
    assert "no weights / in a_folder" in markdown.replace("|", "/") and r"no weights | in a\_folder" in latex
    assert "+1.50 [+1.50, +1.50]" in markdown and r"+1.50\\{\scriptsize [+1.50, +1.50]}" in latex
    for begin, end in ((r"\begin{tabular}", r"\end{tabular}"), (r"\begin{table*}", r"\end{table*}"), ("{", "}")):
        assert latex.count(begin) == latex.count(end) > 0


def test_the_csv_holds_every_summary(tmp_path):
    write_metrics(tmp_path / "rows.csv", study_records())
    tabulate(SETTINGS, records=[tmp_path / "rows.csv"], **paths(tmp_path))
    with (tmp_path / "out.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert len(lines) == 2 * 2 * 3 + 2 * 2  # means, and the reference, which is the best, minus the other
    assert {line["mean"] for line in lines if line["metric"] == "clip_d"} == {""}


def test_records_survive_the_disk(tmp_path):
    records = study_records()
    write_metrics(tmp_path / "rows.csv", records)
    table = read_metrics([tmp_path / "rows.csv"])
    for written, read in zip(records, table.astype(object).where(table.notna(), None).to_numpy(), strict=True):
        read = MetricRecord(*read)
        assert read._replace(value=None) == written._replace(value=None)
        assert read.value == (None if written.value is None else pytest.approx(written.value, rel=1e-8))


def test_an_infinite_value_becomes_null_with_a_reason():
    record = metric_record(
        StudyPoint("a", "b", "c", 0, 0.25, 0.0, "files"), "test", (0, 0), "full", "psnr", float("inf")
    )
    assert record.value is None and "infinite" in record.reason


def test_the_same_measurement_twice_is_an_error():
    records = study_records(["surfhead"], [0.0])
    with pytest.raises(CarigsError, match=r"surfhead.*psnr of full is given twice.*camera 0"):
        summaries([*records, records[0]])


GOOD = "toy,toy,surfhead,0,0.25,0,EXP-2,test,1,2,full,psnr,30.5,"


@pytest.mark.parametrize(
    ("line", "field"),
    [
        (GOOD.replace("30.5", "many"), "line 2, value"),
        (GOOD.replace("30.5", "nan"), "line 2, value"),
        (GOOD.replace("30.5", ""), "line 2, value"),
        (GOOD.replace("0.25", "x"), "line 2, gamma"),
        (GOOD.replace(",0,0.25", ",0.5,0.25"), "line 2, seed"),
        (GOOD.replace(",1,", ",1.5,"), "line 2, camera"),
        (GOOD + ",", "line 2"),
        ("toy", "line 2"),
    ],
)
def test_a_malformed_record_names_its_file_and_line(tmp_path, line, field):
    file = tmp_path / "rows.csv"
    file.write_text(",".join(MetricRecord._fields) + "\n" + line + "\n")
    with pytest.raises(InputError) as caught:
        read_metrics([file])
    assert caught.value.field == field and str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_a_wrong_header_or_a_missing_file_is_an_input_error(tmp_path):
    (tmp_path / "rows.csv").write_text("a,b\n")
    with pytest.raises(InputError, match="expected the columns study, subject"):
        read_metrics([tmp_path / "rows.csv"])
    with pytest.raises(InputError, match="no such file"):
        read_metrics([tmp_path / "none.csv"])
