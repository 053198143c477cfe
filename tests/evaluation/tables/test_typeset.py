"""The readable tables: table 1 of the paper, directions, the best values, subjects, and what a footnote may say."""

import re

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.settings import Tabulate
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.document import Cell, Document, Table, to_latex, to_markdown, without_paths
from evaluation.tables.metric import Metric
from evaluation.tables.metric_records import StudyPoint, metric_record
from evaluation.tables.published import PUBLISHED
from evaluation.tables.summary import summarise
from evaluation.tables.typeset import comparison_tables

SETTINGS = Tabulate()
METRICS = {
    "up": Metric("Up", "higher", 1, "", "a test", "paper"),
    "down": Metric("Down", "lower", 1, "mm", "a test", "paper"),
    "level": Metric("Level", "neither", 1, "", "a test", "paper"),
}


def records(values, *, subjects=("anna",), seeds=(0,), metric="up", frames=12, protocol="test"):
    """Values of the frames of each variant and seed; every second frame is `spread` off."""
    return [
        metric_record(StudyPoint("s", subject, variant, seed, 0.25, 0.25, "files"), protocol, (frame % 4, frame // 4),
                      "full", metric, value + 0.1 * i + spread * (-1) ** frame)
        for i, subject in enumerate(subjects) for variant, (value, spread) in values.items() for frame in range(frames)
        for seed in seeds
    ]  # fmt: skip


def tables(rows, catalogue=METRICS):
    return comparison_tables(summarise(pd.DataFrame(rows), SETTINGS, catalogue), SETTINGS, catalogue)


def cells(document, title, variant, block=0):
    (table,) = [table for table in document.tables if table.title.endswith(title)]
    return dict(table.blocks[block][1])[variant]


TABLE_1 = "Table 1 of the paper, level 0.25"


def test_table_1_has_the_methods_and_columns_of_the_paper_and_its_published_values():
    document = tables(records({"alternating": (0.7, 0.1), "surfhead": (0.6, 0.1)}, metric="clip_d"), CATALOGUE)
    table = next(table for table in document.tables if table.title.endswith(TABLE_1))
    columns = [name for name, metric in CATALOGUE.items() if metric.table == "paper"]
    assert [heading.split(" (")[0].rstrip(" ↑↓") for heading in table.header] == [CATALOGUE[c].title for c in columns]
    (own, lines), (published, values) = table.blocks
    assert (own, [name for name, _ in lines]) == ("this study, anna", ["surfhead", "alternating"])
    assert published == "published by the paper"
    for method, row in values:
        assert [cell.value for cell in row] == [PUBLISHED[method][column] for column in columns]
    assert any("arXiv 2601.03319" in note for note in document.notes)


@pytest.mark.parametrize(("metric", "best"), [("up", "a"), ("down", "b"), ("level", None)])
def test_the_best_value_is_bold_where_the_metric_has_a_direction(metric, best):
    document = tables(records({"a": (2.0, 0.1), "b": (1.0, 0.1), "alternating": (1.5, 0.1)}, metric=metric))
    for variant in ("a", "b", "alternating"):
        assert [cell.best for cell in cells(document, TABLE_1, variant) if cell.value != "—"] == [variant == best]


def test_a_value_that_is_not_better_in_every_comparison_is_not_bold():
    # b is worse by as much on average, but its frames differ from those of a by up to 3.
    document = tables(records({"a": (2.0, 0.1), "b": (1.9, 3.0), "alternating": (1.0, 0.1)}))
    assert not any(cell.best for v in ("a", "b", "alternating") for cell in cells(document, TABLE_1, v))


def test_a_single_variant_is_not_the_best():
    assert not any(cell.best for cell in cells(tables(records({"a": (2.0, 0.1)})), TABLE_1, "a"))


def test_headings_have_arrow_unit_protocol_and_count():
    values = {"a": (2.0, 0.1), "alternating": (1.5, 0.1)}
    rows = [row for metric in METRICS for row in records(values, metric=metric)]
    table = next(table for table in tables(rows).tables if table.title.endswith(TABLE_1))
    assert table.header == ["Up ↑ (test, n=12)", "Down ↓ (mm, test, n=12)", "Level (test, n=12)"]
    rows = [row for row in rows if (row.variant, row.camera) != ("a", 0)]
    document = tables(rows)
    assert document.tables[0].header[0] == "Up ↑ (test)"
    assert [cells(document, TABLE_1, v)[0].note for v in ("a", "alternating")] == ["n=9", "n=12"]


def test_frames_of_another_protocol_get_a_table_of_their_own():
    rows = records({"a": (2.0, 0.1)}) + records({"a": (3.0, 0.1)}, protocol="val")
    document = tables(rows)
    assert cells(document, TABLE_1, "a")[0].value == "2.0"
    assert cells(document, "Table 1 of the paper, val, all levels", "a")[0].value == "3.0"


def test_several_subjects_are_pooled_and_shown_one_by_one():
    document = tables(records({"a": (2.0, 0.0), "alternating": (1.0, 0.0)}, subjects=("anna", "ben", "cleo")))
    pooled = cells(document, TABLE_1, "a")[0]
    assert (pooled.value, pooled.interval) == ("2.1", "[1.9, 2.3]")  # 2, 2.1 and 2.2: t of 2 degrees of freedom
    by_subject = [cells(document, "Table 1 of the paper by subject, level 0.25", "a", block)[0] for block in range(3)]
    assert [cell.value for cell in by_subject] == ["2.0", "2.1", "2.2"]
    assert "3 subjects" in document.explanation[0] and document.tables[0].blocks[0][0] == "this study, 3 subjects"


def test_one_subject_is_said_to_be_one():
    (scope, *_) = tables(records({"a": (2.0, 0.1)})).explanation
    assert "One subject (anna)" in scope and "nothing of other people" in scope


def test_the_number_of_seeds_stands_with_the_tables():
    document = tables(records({"a": (2.0, 0.1), "alternating": (1.5, 0.1)}, seeds=(0, 1, 5)))
    assert document.tables[0].header[0] == "Up ↑ (test, n=36, 3 seeds)"
    (scope, *_) = document.explanation
    assert "trained with 3 seeds" in scope and "cameras and seeds are random factors" in scope


def test_a_single_training_is_said_to_be_one():
    for subjects in (("anna",), ("anna", "ben")):
        (scope, *_) = tables(records({"a": (2.0, 0.1)}, subjects=subjects)).explanation
        assert "trained once" in scope and "randomness of training" in scope


def test_footnotes_hold_no_path_of_the_machine():
    reason = (
        "no clip weights (a.pt) in /home/me/w, /root/.cache/hub; get them from https://host.org/a/b.pt, licence MIT"
    )
    point = StudyPoint("s", "anna", "a", 0, 0.25, 0.25, "files")
    document = tables([metric_record(point, "test", (None, None), "full", "up", None, reason)])
    assert document.notes[0] == "(a) no clip weights (a.pt); get them from https://host.org/a/b.pt, licence MIT"
    assert cells(document, TABLE_1, "a")[0] == Cell("—", note="(a)")


name = st.text(st.characters(categories=["L", "N"], include_characters=" .-_"), min_size=1, max_size=8).map(str.strip)


@given(st.lists(name.filter(bool), min_size=2, max_size=4), st.sampled_from(["/", "~/", "C:\\"]))
def test_no_absolute_path_survives(parts, start):
    path = start + ("\\" if "\\" in start else "/").join(part.replace(" ", "") or "x" for part in parts)
    for text in (f"nothing in {path}; get it", f"{path}: broken", f"nothing in here, {path}"):
        assert path not in without_paths(text) and not re.search(r"(^|\s)(~?/|C:\\)\S", without_paths(text))


@pytest.mark.parametrize("text", ["no pixel of this region in view", "see https://a.org/b/c", "PSNR / SSIM", "a/b"])
def test_other_texts_are_kept(text):
    assert without_paths(text) == text


def test_special_characters_are_escaped():
    table = Table("a_b", ["50 % ↑ (test)"], [("x & y", [("no_mask", [Cell("1", "[0, 2]", "(a)", best=True)])])])
    document = Document(["5 # 6"], [table], {"$3": 0})
    assert r"\textbf{1}" in to_latex(document) and "**1** [0, 2] (a)" in to_markdown(document)
    for text in (r"a\_b", r"50 \% $\uparrow$", r"x \& y", r"no\_mask", r"5 \# 6", r"(a) \$3"):
        assert text in to_latex(document)
