"""Fingerprints of modules: digests of all source files of this project that a module depends on."""

from __future__ import annotations

import ast
from functools import cache
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("carigs", "evaluation")
DATA = (".toml", ".json", ".jinja", ".css", ".js", ".vert", ".frag")
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
    return sha256("\n".join(map(_digest, sources(module))).encode()).hexdigest()[:16]


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
    file = _file(module)
    if file is None:
        raise ModuleNotFoundError(f"carigs and evaluation have no module {module}")
    files: set[Path] = set()
    pending = [file]
    while pending:
        file = pending.pop()
        if file not in files:
            files |= {file, *_data(file)}
            pending += _imported(file)
    return sorted(files)


def _file(module: str) -> Path | None:
    """The file of a module of `PACKAGES`; None for other modules and for names that are not modules."""
    path = ROOT.joinpath(*module.split("."))
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if module.split(".")[0] in PACKAGES and file.is_file()), None)


# A workflow asks for the fingerprints of thirty modules, which share most of their sources.
@cache
def _digest(file: Path) -> str:
    content = ast.dump(ast.parse(file.read_bytes())) if file.suffix == ".py" else file.read_text("utf-8")
    return sha256(content.encode()).hexdigest()


@cache
def _data(file: Path) -> tuple[Path, ...]:
    return tuple(data for data in file.parent.glob(f"{file.stem}.*") if data.suffix in DATA)


@cache
def _imported(file: Path) -> tuple[Path, ...]:
    """Modules of this project that a module imports."""
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):  # relative imports are not used
            names += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
    files = [_file(name) for name in names if name.startswith(PACKAGES) and not name.startswith(WITHOUT_EFFECT)]
    return tuple(file for file in files if file)
