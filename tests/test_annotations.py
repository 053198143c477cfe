"""Names in annotations exist: shape strings keep ruff from checking them."""

from __future__ import annotations

import ast
import builtins
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted(file for package in ("carigs", "evaluation") for file in (ROOT / package).rglob("*.py"))


def defined(tree: ast.Module) -> set[str]:
    """Every name that a module imports, defines or assigns anywhere."""
    names = set(dir(builtins))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


def annotations(tree: ast.Module) -> list[ast.expr]:
    """The annotations of arguments, results and variables."""
    found = [node.annotation for node in ast.walk(tree) if isinstance(node, ast.arg | ast.AnnAssign)]
    found += [node.returns for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return [annotation for annotation in found if annotation is not None]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_annotations_name_what_exists(file):
    tree = ast.parse(file.read_text("utf-8"))
    used = {node.id for a in annotations(tree) for node in ast.walk(a) if isinstance(node, ast.Name)}
    assert used - defined(tree) == set()
