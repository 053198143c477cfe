"""`carigs plan`: what a study will cost."""

import json

import pytest

from carigs.cli import plan
from carigs.cli.main import main as carigs
from carigs.config import project_root
from carigs.errors import SettingsError
from carigs.planning import study_plan
from carigs.planning.costs import REFERENCE_SPEED
from carigs.planning.job_graph import Job, study_jobs


def job(number, rule, needs=(), **wildcards):
    is_local = rule == "settings"
    return Job(number, rule, wildcards, 1, 6000.0, 0.0, is_local, None, tuple(needs))


STUDY = [
    job(0, "settings"),
    job(1, "capture", [0], subject="toy"),
    *(job(n, "train", [1], subject="toy", variant=name) for n, name in ((2, "surfhead"), (3, "no_mask"))),
    job(4, "tabulate", [2, 3]),
]


@pytest.fixture
def small_study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plan, "study_jobs", lambda *arguments, **options: STUDY)


def test_more_nodes_take_less_time_and_the_same_work(small_study, capsys):
    plans = []
    for nodes in ("1", "2"):
        assert carigs(["plan", "--nodes", nodes, "--cores", "1", "--json"]) == 0
        plans.append(json.loads(capsys.readouterr().out))
    one, two = plans
    speed = two["speed"] / one["speed"]  # measured anew by each command
    assert two["core_seconds"] == pytest.approx(speed * one["core_seconds"])
    assert two["makespan_seconds"] < 0.7 * speed * one["makespan_seconds"]
    assert two["critical_path_seconds"] == pytest.approx(two["makespan_seconds"])
    assert [step["rule"] for step in two["critical_path"]] == ["settings", "capture", "train", "tabulate"]
    assert {rule: row["jobs"] for rule, row in one["rules"].items()} == {
        "settings": 1, "capture": 1, "train": 2, "tabulate": 1
    }  # fmt: skip


def test_the_text_says_how_sure_it_is(small_study, capsys):
    assert carigs(["plan"]) == 0
    text = capsys.readouterr().out
    assert "5 jobs, " in text and "on 1 node with 2 cores: " in text and "critical path" in text
    assert "216 training images, 54 others, 0.0566 megapixels (from capture.toy)" in text
    assert "uncertainty: times from the table of costs" in text
    assert "0 of 2" in text


def test_what_fits_on_no_node_and_wrong_settings_are_one_line(small_study, capsys):
    assert carigs(["plan", "--memory", "1000"]) == 1
    assert "a job of the rule capture needs 1 cores and 6000 MB; a node has 2 and 1000 MB" in capsys.readouterr().err
    assert carigs(["plan", "train.iteration=3"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("carigs: train.iteration") and error.count("\n") == 1


def test_an_empty_plan_is_no_error(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plan, "study_jobs", lambda *arguments, **options: [])
    assert carigs(["plan", "--remaining"]) == 0
    assert capsys.readouterr().out == "nothing to do\n"


@pytest.mark.slow
def test_the_jobs_are_those_of_snakemake(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    snakefile = str(project_root() / "Snakefile")
    config = ["hydra=study.variants=[alternating,surfhead] study.levels=[0.25] "]
    jobs = study_jobs(config, snakefile, ["reproduce", "table"], 4, from_scratch=True)
    by_number = {each.number: each for each in jobs}
    assert [each.wildcards["variant"] for each in jobs if each.rule == "train"].count("surfhead") == 1
    assert sum(each.rule == "render" for each in jobs) == 2  # one for each variant, of both levels
    assert not any(each.is_local for each in jobs if each.rule in ("capture", "train", "render"))
    assert all(each.is_local for each in jobs if each.rule == "settings")
    render = next(each for each in jobs if each.rule == "render")
    assert {by_number[n].rule for n in render.needs} >= {"train", "capture", "exaggerate"}
    order = [each.number for each in jobs]
    assert all(order.index(n) < order.index(each.number) for each in jobs for n in each.needs)
    assert not (tmp_path / "results").exists()
    with pytest.raises(SettingsError, match="Snakemake cannot plan the study"):
        study_jobs(config, snakefile, ["no_such_rule"], 4, from_scratch=True)


@pytest.mark.slow
def test_the_papers_study_is_planned_with_its_hours_without_its_data(tmp_path, monkeypatch, capsys):
    """Ten people, three kinds of supervision and the hair mask, five levels, 256 frames, 120,000 iterations."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NERSEMBLE", str(tmp_path / "nersemble"))
    monkeypatch.setattr(study_plan, "speed_test", lambda: REFERENCE_SPEED)
    assert carigs(["plan", "study=paper", "--nodes", "10", "--cores", "4", "--json"]) == 0
    planned = json.loads(capsys.readouterr().out)
    counts = {rule: row["jobs"] for rule, row in planned["rules"].items()}
    people, variants, levels = 10, 4, 5
    assert counts["capture"] == counts["exaggerate"] == counts["gtstar"] == counts["figures"] == people
    assert counts["train"] == people * variants and counts["tabulate"] == 1
    assert counts["render"] == counts["metrics"] == people * variants
    # One training alone is 120,000 times a step: more than one hour and less than a day on the machine of the table.
    hours = planned["rules"]["train"]["seconds"] / 3600 / counts["train"]
    assert 1 < hours < 24
    assert planned["makespan_seconds"] / 3600 > hours
    assert planned["rules"]["render"]["bytes"] == pytest.approx(
        people * variants * (levels * 280 + 500) * 441_100, rel=1e-3
    )
