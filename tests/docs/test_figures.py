"""Tables of figures name the commit that they were measured at, and no later commit moves them."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from docs.blocks import ROOT
from shared_data import DATA

pytestmark = pytest.mark.docs


class Measurement(NamedTuple):
    """Figures that change together."""

    moved: tuple[str, ...] = ()
    """Commits that changed them before commits named what they move in their last line."""
    data: tuple[str, ...] = ()
    """What they are measured on below `CARIGS_DATA`, if the repository does not make it: see docs/test-data.md."""
    command: str = "make bench"
    """What a maintainer runs to measure them again."""


MODEL, MESHES = "ict_model.npz", "meshes"
SECTION = "what the section names"
MEASUREMENTS = {
    "toy": Measurement(("accb12e",), (), "make reproduce"),
    "ict_s1": Measurement(("accb12e",), ("ict_s1", MODEL), 'make reproduce HYDRA="study=ict"'),
    "ict_s7": Measurement(("19f591b",), ("ict_s7", MODEL), "the command in docs/results/ict_s7/README.md"),
    "tracking": Measurement(("5d2981b",), (), "python -m evaluation.benchmarks.tracking_errors FILE.csv"),
    "gtstar": Measurement(
        ("df35219",), ("ict_s1", "ict_s7", MODEL), "python -m evaluation.benchmarks.trusted_pixels FILE.csv FOLDER"
    ),
    "light": Measurement(("c74b82e",)),
    "exaggeration": Measurement((), (MESHES, MODEL)),
    "fitting": Measurement((), ("ict_s1", "ict_s7", MODEL), SECTION),
    "footage": Measurement((), (), SECTION),
    "tracked_heads": Measurement(
        (), ("ict_s1", MODEL), "python -m evaluation.benchmarks.footage.tracked_heads FILE.csv"
    ),
    "mattes": Measurement(
        (), ("ict_s1", "ict_s7", MODEL), "python -m evaluation.benchmarks.footage.matte_errors FILE.csv"
    ),
    "footage_training": Measurement((), (), "python -m evaluation.benchmarks.footage.trained_footage FILE.csv"),
    "kernels": Measurement(("6ba7be7",)),
    "metrics": Measurement(("d691ad4",), (), "python -m evaluation.benchmarks.image_metric_cost FILE.csv"),
    "gpu": Measurement((), (), "make gpu"),
    "jobs": Measurement(("a7c9c32",), (), "carigs run"),
    "viewer": Measurement(
        ("8414454",), ("ict_s1", MODEL), "python -m evaluation.benchmarks.viewer FILE.csv ict_s1=AVATAR.npz"
    ),
    "html": Measurement(("cc059ed",), ("ict_s1", MODEL), SECTION),
    "plans": Measurement((), ("ict_s1", MODEL), SECTION),
    "regions": Measurement((), (MODEL,), SECTION),
    "embedding": Measurement((), ("ict_s7", MODEL, "real"), SECTION),
    "exposure": Measurement((), ("ict_s1", "ict_s7", MODEL), SECTION),
    "hulls": Measurement(
        (), ("ict_s1", "ict_s7", MODEL), "python -m evaluation.benchmarks.few_cameras FILE.csv DATASET HEAD_MODEL"
    ),
    "outlines": Measurement((), ("ict_s1", "ict_s7", MODEL), SECTION),
    "editing": Measurement((), (), SECTION),
    "tests": Measurement((), (), SECTION),
}
"""What is measured."""
TRAILER = re.compile(r"^Moves-figures: *(.+)$", re.MULTILINE)
MEASURED = re.compile(r"Measured at commit `([0-9a-f]{7,40})` \(((?:`\w+`(?:, )?)+)\)")
GENERATED = {
    "docs/benchmarks.md": ["toy", "exaggeration", "gtstar", "light", "kernels"],
    "docs/results/toy/card.md": ["toy"],
    "docs/results/ict/card.md": ["ict_s1"],
    "docs/results/ict_s7/card.md": ["ict_s7"],
}
"""What commands wrote that state the commit themselves, as `COMMIT`, and what it was measured on."""
COMMIT = re.compile(r"^(?:- )?Commit: ([0-9a-f]{40})\.$", re.MULTILINE)
WITHOUT_FIGURES = {
    "docs/configuration.md": "ranges of settings",
    "docs/weights.md": "sizes of files",
    "docs/installation.md": "versions of packages",
    "docs/paper.md": "settings, and figures of the paper",
    "docs/results/toy/table.md": "its card states the commit",
    "docs/results/ict/table.md": "its card states the commit",
    "docs/results/ict_s7/table.md": "its card states the commit",
}
DOCUMENTS = [
    document
    for document in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if "notebook" not in document.parts and document.relative_to(ROOT).as_posix() not in {*GENERATED, *WITHOUT_FIGURES}
]
NUMBER = re.compile(r"[-+−<≤]?\s*\d+\.\d+")
MANY = 6
"""Cells with a decimal fraction that make a table one of figures."""


def sections(document: Path) -> Iterator[tuple[str, str]]:
    """The text before the first heading of the second level, and the sections below such headings."""
    heading = document.name
    lines: list[str] = []
    for line in document.read_text("utf-8").splitlines():
        if line.startswith("## "):
            yield heading, "\n".join(lines)
            heading, lines = line[3:], []
        lines.append(line)
    yield heading, "\n".join(lines)


def has_figures(section: str) -> bool:
    """Whether a table of the section has many decimal fractions."""
    cells = [cell for line in section.splitlines() if line.startswith("|") for cell in line.split("|")]
    return sum(bool(NUMBER.search(cell)) for cell in cells) >= MANY


def git(*arguments: str) -> str:
    """What git prints; an empty text if it fails."""
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


@cache
def history() -> list[str]:
    """All commits up to the present one; empty where the whole history is not there."""
    return git("rev-list", "HEAD").split() if git("rev-parse", "--is-shallow-repository") == "false" else []


def full_name(commit: str) -> str:
    """The full name of a commit of the history, or an empty text."""
    return next((name for name in history() if name.startswith(commit)), "")


@cache
def moves() -> dict[str, list[str]]:
    """The commits that moved each measurement."""
    moved = {name: [full_name(commit) for commit in found.moved] for name, found in MEASUREMENTS.items()}
    for entry in git("log", "--format=%H%n%B%x00").split("\0"):
        commit, _, message = entry.strip().partition("\n")
        for names in TRAILER.findall(message):
            for name in names.split(","):
                moved.setdefault(name.strip(), []).append(commit)
    return moved


def tables() -> list[tuple[str, str, str, list[str]]]:
    """Document, section, commit and measurements of each note."""
    generated = [
        (document, "", commit, names)
        for document, names in GENERATED.items()
        for commit in COMMIT.findall((ROOT / document).read_text("utf-8"))
    ]
    return generated + [
        (document.relative_to(ROOT).as_posix(), heading, commit, re.findall(r"`(\w+)`", names))
        for document in DOCUMENTS
        for heading, section in sections(document)
        for commit, names in MEASURED.findall(section)
    ]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_tables_of_figures_name_their_commit(document):
    bare = [heading for heading, section in sections(document) if has_figures(section) and not MEASURED.search(section)]
    assert bare == []


def test_the_notes_are_written_as_the_tests_read_them():
    written = sum(document.read_text("utf-8").count("Measured at commit") for document in DOCUMENTS)
    assert len(tables()) - len(GENERATED) == written > 5
    assert {document for document, *_ in tables()} >= GENERATED.keys()
    assert {name for *_, names in tables() for name in names} <= MEASUREMENTS.keys()


@pytest.mark.skipif(not history(), reason="needs the whole history of the repository")
def test_commits_that_move_figures_name_known_measurements():
    assert moves().keys() <= MEASUREMENTS.keys()
    assert all(all(commits) for commits in moves().values()), "a commit of MEASUREMENTS is not in the history"


def missing_data(name: str) -> list[str]:
    """What a measurement needs of `CARIGS_DATA` and does not find there."""
    return [entry for entry in MEASUREMENTS[name].data if DATA is None or not (DATA / entry).exists()]


def verdict(where: str, later: dict[str, str]) -> tuple[list[str], list[str]]:
    """What has to be measured again here, and what only somebody with the data can measure.

    Args:
        where: Document and section.
        later: Measurements that commits after that of the table have moved, with the last of these commits.

    Returns:
        Two lists of lines.
    """
    here, elsewhere = [], []
    for name, commit in later.items():
        missing, command = missing_data(name), MEASUREMENTS[name].command
        line = f"{where}: {commit} moved `{name}`; measure again with {command}"
        if missing:
            elsewhere.append(f"{line} on {', '.join(missing)}, which is not in CARIGS_DATA: not checked")
        else:
            here.append(line)
    return here, elsewhere


@pytest.mark.skipif(not history(), reason="needs the whole history of the repository")
@pytest.mark.parametrize(("document", "heading", "commit", "names"), tables())
def test_no_later_commit_moves_a_table(document, heading, commit, names):
    """A table of data that are not here cannot be measured again here: the test is skipped, and says what is open."""
    measured = full_name(commit)
    assert measured, f"{commit} is not a commit of the history"
    before = git("rev-list", measured).split()
    later = {name: moved[:7] for name in names for moved in moves()[name] if moved not in before}
    here, elsewhere = verdict(f"{document}, {heading}", later)
    assert here == []
    if elsewhere:
        pytest.skip("; ".join(elsewhere))


def test_figures_are_demanded_only_where_their_data_are(tmp_path, monkeypatch):
    moved = {"toy": "1234567", "ict_s1": "89abcde"}
    monkeypatch.setattr(sys.modules[__name__], "DATA", None)
    here, elsewhere = verdict("docs/x.md, Times", moved)
    assert [re.findall("`(.*?)`", line) for line in (*here, *elsewhere)] == [["toy"], ["ict_s1"]]
    assert "study=ict" in elsewhere[0]
    assert elsewhere[0].endswith("on ict_s1, ict_model.npz, which is not in CARIGS_DATA: not checked")
    (tmp_path / "ict_s1").mkdir()
    (tmp_path / MODEL).touch()
    monkeypatch.setattr(sys.modules[__name__], "DATA", tmp_path)
    here, elsewhere = verdict("docs/x.md, Times", moved)
    assert (len(here), elsewhere) == (2, [])
