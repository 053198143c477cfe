"""Every public function says what it takes, what it returns and what it raises."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted(file for package in ("carigs", "evaluation") for file in (ROOT / package).rglob("*.py"))


def public_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Functions and methods without a leading underscore; neither properties nor what is defined within functions."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
                    decorators = {ast.unparse(decorator) for decorator in method.decorator_list}
                    if not decorators & {"property", "cached_property"}:
                        yield method


def missing_sections(function: ast.FunctionDef) -> list[str]:
    """The sections that the docstring of a function lacks."""
    text = ast.get_docstring(function) or ""
    arguments = function.args
    names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    names += [a.arg for a in (arguments.vararg, arguments.kwarg) if a]
    missing = []
    if set(names) - {"self", "cls"} and "Args:" not in text:
        missing.append("Args")
    returns = function.returns is not None and ast.unparse(function.returns) not in ("None", "NoReturn")
    returns |= function.returns is None and any(isinstance(n, ast.Return) and n.value for n in ast.walk(function))
    if returns and "Returns:" not in text and "Yields:" not in text:
        missing.append("Returns")
    if any(isinstance(node, ast.Raise) and node.exc for node in ast.walk(function)) and "Raises:" not in text:
        missing.append("Raises")
    return missing


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_public_functions_document_arguments_results_and_errors(file):
    tree = ast.parse(file.read_text("utf-8"))
    lacking = {f.name: missing for f in public_functions(tree) if (missing := missing_sections(f))}
    assert lacking == {}
