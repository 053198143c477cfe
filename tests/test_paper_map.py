"""docs/paper.md says where everything of the paper is: every row names code and tests that exist."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from carigs.config import compose

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/paper.md"
CODE = re.compile(r"`((?:carigs|evaluation|workflow)/[\w/]+\.(?:py|smk))(?::([\w.]+))?`")
TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
STAGES = "capture|hair|exaggerate|gtstar|train|render|truth|metrics|tabulate|figures|study"
SETTING = re.compile(rf"`((?:{STAGES})\.[\w.]+)`")
MAPS = ("Equations", "Masks", "Training schedule", "Metrics", "Figures and tables", "Settings")


def rows() -> list[tuple[str, str]]:
    """Section and text of every row of the maps, without the headings."""
    found, section = [], ""
    lines = PAGE.read_text("utf-8").splitlines()
    for i, line in enumerate(lines):
        if line.startswith("## "):
            section = line[3:].strip()
        elif line.startswith("|") and i > 0 and lines[i - 1].startswith("|") and not line.startswith("| ---"):
            found.append((section, line))
    return [row for row in found if row[0] in MAPS]


@cache
def names(file: str) -> set[str]:
    """What a Python file defines: functions, classes, methods as `Class.method`, fields and constants."""
    found = set()
    for node in ast.parse((ROOT / file).read_text("utf-8")).body:
        targets = [node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", [])
        found |= {n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)}
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            for member in node.body:
                if isinstance(member, ast.FunctionDef):
                    found.add(f"{node.name}.{member.name}")
                elif isinstance(member, ast.AnnAssign | ast.Assign):
                    targets = [member.target] if isinstance(member, ast.AnnAssign) else member.targets
                    found |= {f"{node.name}.{n.id}" for n in targets if isinstance(n, ast.Name)}
    return found


def test_every_section_is_there():
    assert {section for section, _ in rows()} == set(MAPS)


@pytest.mark.parametrize("row", [row for _, row in rows()], ids=lambda row: row.split("|")[1].strip()[:40])
def test_a_row_of_the_papers_map_resolves(row):
    code, tests = CODE.findall(row), TEST.findall(row)
    assert code, "no file of ours is named"
    assert tests, "no test is named"
    for file, name in code:
        assert (ROOT / file).is_file(), file
        if name and file.endswith(".py"):
            assert name in names(file), f"{file} has no {name}"
    for file, name in tests:
        assert name in names(file), f"{file} has no {name}"
    for setting in SETTING.findall(row):
        value = compose()
        for key in setting.split("."):
            assert key in value, f"{setting} is no setting"
            value = value[key]
