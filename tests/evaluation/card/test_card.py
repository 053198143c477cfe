"""The benchmark card: its schema, its numbers against their definition, and what it says of what is missing."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import replace
from itertools import product
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
import scipy.stats

from carigs.errors import InputError
from carigs.runs.job_record import JobCosts
from carigs.settings import Tabulate
from evaluation.card.card import make_card, read_card, write_card
from evaluation.card.costs import RecordedJob, RenderingJob, avatar_values, frame_step, stage_values
from evaluation.card.document import card_parts, write_markdown
from evaluation.card.provenance import commit, find_seeds, machine, versions
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.metric_records import MetricRecord
from evaluation.tables.summary import summarise
from evaluation.tables.summary_file import read_summaries, write_summaries

SCHEMA = json.loads((Path(__file__).parents[3] / "docs/card.schema.json").read_text())
SETTINGS = Tabulate(reference="ours")
PROVENANCE = {"machine": machine(), "versions": versions(), "commit": commit(Path("nowhere"))}
REASON = "no weights in /home/anna/.cache/hub; get them from https://weights.org/clip"


def records(subjects=("anna",)) -> pd.DataFrame:
    """PSNR 30 at level 0 and 20 at 0.25, one more for the baseline; CLIP-I without a value."""
    points = product(subjects, ("ours", "base"), (0.0, 0.25), range(3), range(4))
    lines = []
    for subject, variant, level, camera, timestep in points:
        point = ("study", subject, variant, 0, 0.25, level, "files", "test", camera, timestep, "full")
        value = 30.0 - 40 * level + (variant == "base") + 0.01 * camera
        lines.append(MetricRecord(*point, "psnr", value, ""))
        lines.append(MetricRecord(*point, "clip_i_cos", None, REASON))
    return pd.DataFrame(lines)


def card_of(summaries: pd.DataFrame, costs=(), subjects=("anna",)):
    images = {subject: [40, 48] for subject in subjects}
    return make_card(
        summaries,
        costs,
        SETTINGS,
        CATALOGUE,
        images=images,
        training_seeds=[0],
        seeds={"capture.toy.seed": 3},
        provenance=PROVENANCE,
    )


@pytest.fixture(scope="module")
def summaries() -> pd.DataFrame:
    return summarise(records(), SETTINGS, CATALOGUE)


def test_a_card_follows_its_schema_and_comes_back(summaries, tmp_path):
    costs = stage_values(
        {"train": [RecordedJob("train", "a"), RecordedJob("train", "b")]},
        {RecordedJob("train", "a"): JobCosts(5.0, 4.0, None)},
    )
    card = card_of(summaries, costs)
    write_card(tmp_path / "card.json", card)
    content = json.loads((tmp_path / "card.json").read_text())
    jsonschema.validate(content, SCHEMA)
    assert {entry["measure"] for entry in content["values"]} == content["measures"].keys()
    assert {entry["protocol"] for entry in content["values"]} <= content["protocols"].keys()
    assert read_card(tmp_path / "card.json") == card


def test_the_schema_refuses_a_null_without_a_reason_and_a_value_of_no_frames(summaries, tmp_path):
    write_card(tmp_path / "card.json", card_of(summaries))
    content = json.loads((tmp_path / "card.json").read_text())
    for change in ({"value": None, "reason": ""}, {"value": 1.0, "n": 0}, {"protocol": "train"}):
        values = [{**content["values"][0], **change}]
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**content, "values": values}, SCHEMA)


def test_means_and_differences_are_those_of_the_frames(summaries):
    values = {(v.measure, v.variant, v.level, v.minus): v for v in card_of(summaries).values}
    assert values["psnr", "ours", 0.0, ""].value == pytest.approx(30.01)
    assert values["psnr", "base", 0.25, ""].value == pytest.approx(21.01)
    assert values["psnr", "ours", 0.25, "base"].value == pytest.approx(-1)
    assert values["psnr", "ours", 0.0, ""].n == 12
    missing = values["clip_i_cos", "ours", 0.0, ""]
    assert (missing.value, missing.low, missing.n, missing.nulls) == (None, None, 0, 12)


def test_paths_of_the_machine_and_its_name_do_not_appear(summaries, tmp_path):
    card = card_of(summaries)
    write_card(tmp_path / "card.json", card)
    write_markdown(tmp_path / "card.md", card)
    for file in ("card.json", "card.md"):
        text = (tmp_path / file).read_text()
        assert "anna/.cache" not in text
        assert "https://weights.org/clip" in text
        assert "/home/" not in text
        assert os.path.expanduser("~") + "/" not in text
    assert platform.node() not in PROVENANCE["machine"].values()


def test_every_measure_is_explained_with_its_direction(summaries):
    parts = {part.heading: part for part in card_parts(card_of(summaries))}
    items = parts["What the numbers are"].items
    assert any(item.startswith("PSNR: ") and "higher is better" in item for item in items)
    assert len(items) == len(card_of(summaries).measures)
    missing = parts["What is missing"].items
    assert any("https://weights.org/clip" in item for item in missing)
    assert any(item.startswith("Identity: ") for item in missing)


def test_a_card_says_how_often_a_variant_was_trained(summaries):
    for training_seeds, said in (([3], "1 seed (3)"), ([0, 5], "2 seeds (0, 5)")):
        card = replace(card_of(summaries), training_seeds=training_seeds)
        first, second, *_ = card_parts(card)[0].paragraphs
        assert f"each trained with {said}" in first
        assert ("randomness of training" in second) == (len(training_seeds) == 1)


def test_with_several_subjects_tables_show_the_mean_of_all():
    several = ("anna", "bert")
    card = card_of(summarise(records(several), SETTINGS, CATALOGUE), subjects=several)
    part = next(part for part in card_parts(card) if part.heading == "Images at level 0")
    (line,) = [cells for name, cells in part.tables[0].blocks[0][1] if name == "ours"]
    assert line[0].value == "30.01"
    assert line[0].note == "n=24"


def test_summaries_come_back(summaries, tmp_path):
    write_summaries(tmp_path / "table.csv", summaries)
    read = read_summaries(tmp_path / "table.csv")
    texts = ["subject", "variant", "minus", "metric", "reason", "split"]
    assert read[texts].to_numpy().tolist() == summaries[texts].to_numpy().tolist()
    for column in ("mean", "low", "high", "n", "level"):
        np.testing.assert_allclose(read[column], summaries[column].astype(float), rtol=1e-5)


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "\xff\xfe"])
def test_another_file_is_no_summary(text, tmp_path):
    (tmp_path / "table.csv").write_bytes(text.encode("latin1"))
    with pytest.raises(InputError, match=r"table\.csv"):
        read_summaries(tmp_path / "table.csv")


@pytest.mark.parametrize("change", [{"format": "carigs-card-9"}, {"values": [{}]}, {"more": 1}])
def test_another_file_is_no_card(summaries, change, tmp_path):
    write_card(tmp_path / "card.json", card_of(summaries))
    content = {**json.loads((tmp_path / "card.json").read_text()), **change}
    (tmp_path / "card.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"card\.json"):
        read_card(tmp_path / "card.json")


def test_the_time_of_a_frame_is_the_mean_of_what_the_jobs_measured(tmp_path):
    np.savez(tmp_path / "avatar.npz", surfel_binding=np.zeros(7, np.int32))
    job, levels = RecordedJob("render", "anna"), [i / 4 for i in range(4)]
    renderings = [RenderingJob(job, 0, level) for level in levels]
    costs = {job: JobCosts(2.0, 1.0, 100.0, {frame_step(level): 0.2 for level in levels})}
    avatars = {0: tmp_path / "avatar.npz"}
    found = {v.measure: v for v in avatar_values("anna", "ours", avatars, renderings, costs)}
    assert found["surfels"].value == 7
    assert found["avatar_bytes"].value == (tmp_path / "avatar.npz").stat().st_size
    frame, rate = found["frame_seconds"], found["frames_per_second"]
    assert (frame.value, frame.low, frame.high, frame.n) == (pytest.approx(0.2), *[pytest.approx(0.2)] * 2, 4)
    assert rate.value == pytest.approx(5)
    stopped = {job: JobCosts(2.0, 1.0, 100.0, {frame_step(level): 0.0 for level in levels})}
    for without in ({}, stopped):
        unknown = avatar_values("anna", "ours", avatars, renderings, without)
        assert [(v.value is None, bool(v.reason)) for v in unknown] == [(False, False)] * 2 + [(True, True)] * 2


def test_the_costs_of_a_variant_are_means_over_its_seeds(tmp_path):
    avatars = {seed: tmp_path / f"{seed}.npz" for seed in (0, 1)}
    for seed, file in avatars.items():
        np.savez(file, surfel_binding=np.zeros(7 + 2 * seed, np.int32))
    jobs, levels = {seed: RecordedJob("render", str(seed)) for seed in avatars}, [i / 4 for i in range(4)]
    renderings = [RenderingJob(jobs[seed], seed, level) for seed in avatars for level in levels]
    steps = {seed: {frame_step(level): 0.2 + 0.1 * seed for level in levels} for seed in avatars}
    costs = {jobs[seed]: JobCosts(9.0, 1.0, None, steps[seed]) for seed in avatars}
    found = {v.measure: v for v in avatar_values("anna", "ours", avatars, renderings, costs)}
    surfels, frame, rate = (found[name] for name in ("surfels", "frame_seconds", "frames_per_second"))
    assert (surfels.value, surfels.n, frame.n) == (8, 2, 8)
    half = scipy.stats.t.ppf(0.975, 1)  # of 7 and 9: the standard error is 1; a count is not negative
    assert (surfels.low, surfels.high) == (0, pytest.approx(8 + half))
    assert frame.value == pytest.approx(0.25) and frame.high == pytest.approx(0.25 + 0.05 * half)
    assert (rate.value, rate.low, rate.high) == (pytest.approx(4), pytest.approx(1 / frame.high), None)


def test_costs_of_a_stage_are_sums_and_the_largest_memory():
    jobs = [RecordedJob("train", name) for name in "abc"]
    costs = {jobs[0]: JobCosts(5.0, 4.0, 70.0), jobs[1]: JobCosts(3.0, 2.0, 90.0)}
    seconds, cpu, memory = stage_values({"train": jobs}, costs)
    assert (seconds.value, cpu.value, memory.value) == (8.0, 6.0, 90.0)
    assert (seconds.n, seconds.nulls, seconds.reason) == (2, 1, "no record of the costs of 1 of 3 jobs")


def test_seeds_are_found_at_any_depth():
    assert dict(find_seeds({"toy": {"seed": 4, "width": 3}, "seed": 1}, "capture")) == {
        "capture.toy.seed": 4,
        "capture.seed": 1,
    }


def test_values_of_metrics_outside_of_the_catalogue_are_left_out(summaries):
    other = summaries.assign(metric="of_my_own")
    assert card_of(pd.concat([summaries, other])).values == card_of(summaries).values


def test_a_card_names_no_machine_if_told_so(summaries, tmp_path):
    unnamed = {"processor": "not named", "cores": None, "memory_gb": None, "system": ""}
    card = replace(card_of(summaries), machine=unnamed)
    write_card(tmp_path / "card.json", card)
    jsonschema.validate(json.loads((tmp_path / "card.json").read_text()), SCHEMA)
    write_markdown(tmp_path / "card.md", card)
    assert "Machine that wrote the card: not named." in (tmp_path / "card.md").read_text()
