"""An edit re-runs what depends on it, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import pytest

TARGETS = ("reproduce", "table")
SUMMARIES = {"tabulate": 1, "card": 1, "report": 1}
ALTERNATING = {"train": 2, "html": 2, "render": 2, "metrics": 2, "figures": 2, **SUMMARIES}


def append(file: str, line: str) -> Callable:
    return lambda project: project.edit(file, add=line)


def touch_everything(project) -> None:
    """A fresh checkout of the same files is newer than the results."""
    for file in project.root.rglob("*"):
        if file.is_file() and "results" not in file.parts and ".snakemake" not in file.parts:
            file.touch()


WITHOUT_EFFECT = (
    append("conf/variant/alternating.yaml", "# a comment"),
    append("conf/variant/gtstar_only.yaml", "  iterations: 7"),  # a variant that is not in the study
    append("environment.yml", "# a comment"),
    append("carigs/stages/train.py", "# a comment"),
    append("carigs/stages/train.py", '"""A docstring."""'),
    touch_everything,
)
EDITS = {
    "reference of the table": (append("conf/config.yaml", "tabulate: {reference: surfhead}"), {**SUMMARIES}),
    "share of one variant": (
        append("conf/variant/alternating.yaml", "train: {iterations: 7}"),
        {**ALTERNATING},
    ),
    "targets, which the baseline does not use": (
        append("conf/study/toy.yaml", "gtstar: {hair_extinction: 4}"),
        {"gtstar": 2, "target_sheet": 2, **ALTERNATING},
    ),
    "targets of one variant": (
        append("conf/variant/alternating.yaml", "gtstar: {warp: affine}"),
        {"gtstar": 2, "target_sheet": 2, **ALTERNATING},
    ),
    "levels of one variant": (
        append("conf/variant/alternating.yaml", "train: {num_gtstar_levels: 2}"),
        {"gtstar": 2, "target_sheet": 2, **ALTERNATING},
    ),
    "one subject": (
        append("conf/subject/twin.yaml", "  toy: {seed: 2}"),
        {"capture": 1, "hair": 1, "exaggerate": 1, "gtstar": 1, "target_sheet": 1, "truth": 2}
        | {"train": 2, "html": 1, "render": 2, "metrics": 2, "figures": 1, **SUMMARIES},
    ),
    "style of a figure": (append("evaluation/figures/style.py", "more = 1"), {}),
    "code of a stage": (
        append("carigs/stages/render.py", "more = 1"),
        {"render": 4, "metrics": 4, "figures": 2, **SUMMARIES},
    ),
    "code of a stage's package": (
        append("carigs/stages/tabulate.py", "from evaluation.tables import csv_files"),
        {**SUMMARIES},
    ),
}
OVERRIDES = {
    "add a level": (
        "study.levels=[0,0.2,0.25]",
        {"truth": 2, "render": 4, "metrics": 4, "figures": 2, **SUMMARIES},
    ),
    "drop a variant": ("study.variants=[surfhead]", {"figures": 2, **SUMMARIES}),
    "drop a subject": ("study.subjects=[twin]", {**SUMMARIES}),
    "level beyond gamma": ("study.levels=[0,0.25,0.5]", {}),
    "gamma": (
        "gamma=0.2",
        {"settings": 4, "exaggerate": 2, "gtstar": 2, "target_sheet": 2, "truth": 4}
        | {"train": 4, "html": 2, "render": 4, "metrics": 4, "figures": 2, **SUMMARIES},
    ),
    "metrics": ("metrics.crop=center", {"metrics": 4, **SUMMARIES}),
}


@pytest.mark.slow
def test_finished_study_is_up_to_date(made):
    assert made.planned(*TARGETS) == {}


@pytest.mark.slow
def test_nothing_reruns(finished):
    """Not even after all of these edits together."""
    for edit in WITHOUT_EFFECT:
        edit(finished)
    assert finished.planned(*TARGETS) == {}


@pytest.mark.slow
@pytest.mark.parametrize(("edit", "expected"), EDITS.values(), ids=EDITS.keys())
def test_edit_reruns_what_depends_on_it(finished, edit, expected):
    edit(finished)
    assert finished.planned(*TARGETS) == expected


@pytest.mark.slow
@pytest.mark.parametrize(("override", "expected"), OVERRIDES.values(), ids=OVERRIDES.keys())
def test_override_reruns_what_depends_on_it(made, override, expected):
    assert made.planned(*TARGETS, hydra=override) == expected


@pytest.mark.slow
def test_interrupted_run_goes_on(finished):
    """An index may be the same, byte for byte, while the images that it lists are new."""
    edit, expected = EDITS["one subject"]
    edit(finished)
    index = finished.root / "results/toy/twin/capture.json"
    before = index.read_bytes()
    finished.make("results/toy/twin/capture.json")
    assert index.read_bytes() == before
    assert finished.planned(*TARGETS) == {k: n for k, n in expected.items() if k != "capture"}
