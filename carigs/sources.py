"""Fingerprints of modules: digests of all source files of this project that a module depends on."""

from __future__ import annotations

import ast
from functools import cache
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("carigs", "evaluation")
DATA = (".toml", ".json", ".jinja", ".css", ".js")
"""Suffixes of files beside a module that belong to it."""
WITHOUT_EFFECT = ("carigs.settings", "carigs.errors")
"""Modules that fingerprints ignore: settings reach a stage as text, which is compared; errors change no result."""


def fingerprint(module: str) -> str:
    """Digest of a module and of all modules of this project that it imports, directly or indirectly.

    Comments and layout do not count; docstrings do.

    Args:
        module: Name of the module, such as `carigs.stages.train`.

    Returns:
        Sixteen hexadecimal digits.

    Raises:
        ModuleNotFoundError: The project has no such module.
    """
    return sha256("\n".join(map(_content, sources(module))).encode()).hexdigest()[:16]


def sources(module: str) -> list[Path]:
    """Files of a module and of all modules of this project that it imports, inside functions too.

    Data and templates beside a module under its name (`weights.toml` of `weights.py`) belong to it. A package's
    `__init__` counts only if something is imported from the package itself.

    Args:
        module: Name of the module.

    Returns:
        Sorted paths.

    Raises:
        ModuleNotFoundError: The project has no such module.
    """
    if _file(module) is None:
        raise ModuleNotFoundError(f"carigs and evaluation have no module {module}")
    files: set[Path] = set()
    pending = [module]
    while pending:
        name = pending.pop()
        file = None if name.startswith(WITHOUT_EFFECT) else _file(name)
        if file and file not in files:
            files |= {file, *(data for data in file.parent.glob(f"{file.stem}.*") if data.suffix in DATA)}
            pending += _imports(file)
    return sorted(files)


def _file(module: str) -> Path | None:
    """The file of a module of `PACKAGES`; None for other modules and for names that are not modules."""
    path = ROOT.joinpath(*module.split("."))
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if module.split(".")[0] in PACKAGES and file.is_file()), None)


@cache
def _content(file: Path) -> str:
    return ast.dump(_parsed(file)) if file.suffix == ".py" else file.read_text("utf-8")


@cache
def _parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_bytes())


@cache
def _imports(file: Path) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(_parsed(file)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):  # relative imports are not used
            names += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(names)
