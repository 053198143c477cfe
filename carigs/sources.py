"""What a module is made of: the files of ours whose change can change what it does."""

from __future__ import annotations

import ast
from functools import cache
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("carigs", "evaluation")
WITHOUT_EFFECT = ("carigs.settings", "carigs.errors")
"""Settings reach a stage as text, and their values are compared there; the words of an error change no result."""


def fingerprint(module: str) -> str:
    """A digest of the module and of all that it imports of ours, by whatever detour; comments do not count."""
    return sha256("\n".join(map(_meaning, sources(module))).encode()).hexdigest()[:16]


def sources(module: str) -> list[Path]:
    """The files of the module and of what it imports of ours, imports inside functions included.

    Data beside a module under its name (`weights.toml` of `weights.py`) belongs to it.  A package's `__init__` counts
    only where something is imported from the package itself.
    """
    if _file(module) is None:
        raise ModuleNotFoundError(f"no module of ours: {module}")
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = None if name.startswith(WITHOUT_EFFECT) else _file(name)
        if file and file not in found:
            found |= {file, *(data for data in file.parent.glob(f"{file.stem}.*") if data.suffix in (".toml", ".json"))}
            waiting += _imported(file)
    return sorted(found)


def _file(module: str) -> Path | None:
    """The file of a module of ours; None for others' modules and for names that are no modules."""
    path = ROOT.joinpath(*module.split("."))
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if module.split(".")[0] in PACKAGES and file.is_file()), None)


@cache
def _meaning(file: Path) -> str:
    text = file.read_text("utf-8")
    return ast.dump(ast.parse(text)) if file.suffix == ".py" else text


@cache
def _imported(file: Path) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):  # relative imports are not used here
            names += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(names)
