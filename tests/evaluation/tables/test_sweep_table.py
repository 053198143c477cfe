"""The table of a sweep, from tables and records of jobs with known numbers."""

import csv

import numpy as np
import pandas as pd
import pytest

from carigs.errors import SettingsError
from carigs.settings import Sweep
from carigs.stages.sweep import sweep
from carigs.system.files import write_json
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.summary import ALL, SUMMARY
from evaluation.tables.summary_file import write_summaries

VARIANTS = ("alternating", "surfhead")


def summary(gamma, psnr, subjects=("toy",), **changed):
    """PSNR of each variant over the whole image at level gamma, beside lines that a sweep leaves out."""
    lines = []
    for subject in (*([ALL] if len(subjects) > 1 else []), *subjects):
        for place, variant in enumerate(VARIANTS):
            line = dict(zip(SUMMARY, [subject, "toy", gamma, gamma, "test", "full", "psnr", variant, ""], strict=False))
            mean = psnr + place + 100 * (subject != (ALL if len(subjects) > 1 else "toy"))
            line |= {
                "mean": mean,
                "low": mean - 0.5,
                "high": mean + 0.25,
                "n": 27,
                "nulls": 0,
                "reason": "",
                "split": "s",
            }
            others = ({"region": "hair"}, {"protocol": "val"}, {"level": 0.0}, {"minus": "surfhead"})
            lines += [line | changed, *({**line, "mean": -1.0} | other for other in others)]
            lines.append({**line, "metric": "clip_d", "mean": np.nan, "low": np.nan, "n": 0, "reason": "no weights"})
    return pd.DataFrame(lines, columns=SUMMARY)


def study(root, name, gamma, psnr, seconds, **options):
    """The table of a combination, and the records of its trainings: the second variant takes a second longer.

    Those of the seed 9 are of an earlier run of the study.
    """
    file = root / f"results/{name}/table/gamma={gamma:g}.csv"
    write_summaries(file, summary(gamma, psnr, **options))
    for subject in (*options.get("subjects", ["toy"]), "of_another_run"):
        for place, variant in enumerate(VARIANTS):
            own = seconds + place if subject != "of_another_run" else 1000.0
            costs = {"seconds": 1.0, "cpu_seconds": own, "peak_memory_mb": 100 * own}
            record = {"finished": 1, "plan": {}, "params": {}, "inputs": {}, "outputs": {}, "costs": costs}
            point = f"{subject},gamma={gamma:g},{variant}"
            write_json(root / f"results/{name}/log/train/{point},seed=0.json", record)
            earlier = {**record, "costs": {**costs, "cpu_seconds": 1e6, "peak_memory_mb": 1e6}}
            write_json(root / f"results/{name}/log/train/{point},seed=9.json", earlier)
    return file


def write(root, tables, keys, values, **settings):
    """Write a sweep; returns the lines of its CSV file."""
    out = {name: root / f"sweep.{suffix}" for name, suffix in
           (("table", "csv"), ("markdown", "md"), ("figure", "png"), ("vector", "pdf"))}  # fmt: skip
    seeds = [["0"]] * len(tables)
    sweep(Sweep(**settings), tables=tables, swept_keys=keys, swept_values=values, seeds=seeds, **out)
    assert all(file.stat().st_size for file in out.values())
    with out["table"].open() as stream:
        return list(csv.DictReader(stream))


def numbers(line, *names):
    return [float(line[name]) for name in names]


def test_a_combination_and_a_variant_have_a_row_with_their_own_numbers(tmp_path):
    """PSNR is 20 + 10 a + b and variant, the CPU time 10 a + b + variant."""
    values = [(str(a), str(b)) for a in range(2) for b in range(3)]
    tables = [
        study(
            tmp_path, f"toy+train.iterations={a},train.seed={b}", 0.25, 20 + 10 * int(a) + int(b), 10 * int(a) + int(b)
        )
        for a, b in values
    ]
    lines = write(tmp_path, tables, ["train.iterations", "train.seed"], values)
    assert len(lines) == len(values) * len(VARIANTS)
    for line in lines:
        a, b, place = int(line["train.iterations"]), int(line["train.seed"]), VARIANTS.index(line["variant"])
        psnr, cost = 20 + 10 * a + b + place, 10 * a + b + place
        assert numbers(line, "psnr", "psnr_low", "psnr_high", "psnr_n") == [psnr, psnr - 0.5, psnr + 0.25, 27]
        assert numbers(line, "train_cpu_seconds", "train_peak_memory_mb") == [cost, 100 * cost]
        assert line["results"].endswith(f"results/toy+train.iterations={a},train.seed={b}") and line["level"] == "0.25"
        assert "clip_d" not in line
    text = (tmp_path / "sweep.md").read_text()
    assert "| train.iterations=1, train.seed=2, surfhead | 33.00 [32.50, 33.25] |" in text
    assert "Without a value in all combinations: " in text and CATALOGUE["clip_d"].title in text


def test_gammas_of_one_folder_are_compared_each_at_its_own_level(tmp_path):
    tables = [study(tmp_path, "toy", gamma, 100 * gamma, 1000 * gamma) for gamma in (0.1, 0.25)]
    lines = write(tmp_path, tables, ["gamma"], [["0.1"], ["0.25"]])
    found = [(line["gamma"], line["level"], *numbers(line, "psnr", "train_cpu_seconds")) for line in lines[::2]]
    assert found == [("0.1", "0.1", 10, 100), ("0.25", "0.25", 25, 250)]


def test_another_level_can_be_compared(tmp_path):
    """The level 0 has the value -1 in every table."""
    tables = [study(tmp_path, "toy", gamma, 20, 1) for gamma in (0.1, 0.25)]
    lines = write(tmp_path, tables, ["gamma"], [["0.1"], ["0.25"]], level=0.0)
    assert [numbers(line, "psnr") for line in lines] == [[-1]] * 4


def test_of_several_subjects_their_common_mean_is_shown_and_the_mean_cost(tmp_path):
    table = study(tmp_path, "toy", 0.25, 20, 7, subjects=("anna", "ben"))
    first, second = write(tmp_path, [table], ["train.seed"], [["1"]])
    assert numbers(first, "psnr", "train_cpu_seconds", "train_cpu_seconds_n") == [20, 7, 2]
    assert numbers(second, "psnr", "train_cpu_seconds") == [21, 8]


def test_a_value_that_only_some_combinations_have_is_empty_in_the_others(tmp_path):
    tables = [study(tmp_path, "a", 0.25, 20, 1), study(tmp_path, "b", 0.25, 20, 1, mean=np.nan, low=np.nan)]
    lines = write(tmp_path, tables, ["exaggerate"], [["robust"], ["paper"]])
    assert [line["psnr"] for line in lines] == ["20", "21", "", ""]
    assert "| exaggerate=paper, surfhead | — |" in (tmp_path / "sweep.md").read_text()


def test_an_unknown_metric_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(SettingsError, match=r"sweep\.metrics: pnsr is unknown; known: .*psnr"):
        write(tmp_path, [study(tmp_path, "toy", 0.25, 20, 1)], ["train.seed"], [["1"]], metrics=("pnsr",))
    assert not [*tmp_path.glob("sweep.*")]
