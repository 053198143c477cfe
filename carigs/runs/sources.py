"""What a module is made of: the source files of this project and the versions of the packages that it depends on."""

from __future__ import annotations

import ast
import os
from collections.abc import Collection
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from carigs.errors import CarigsError

ROOT = Path(__file__).parents[2]
PACKAGES = ("carigs", "evaluation")
FOLDERS = {"carigs": "", "evaluation": "", "stress": "tests"}
"""Packages that fingerprints follow, and their folders. An installed carigs has no stress tests."""
DATA = (".toml", ".json", ".jinja", ".css", ".js", ".vert", ".frag")
"""Suffixes of files beside a module that belong to it."""
WITHOUT_EFFECT = ("carigs.settings", "carigs.errors", "carigs.runs", "carigs.system")
"""Starts of names of modules that fingerprints ignore. Settings reach a stage as text, which is compared; errors,
the writing of files, locks, records, processes and the places of caches change no result."""
DISTRIBUTIONS = {
    "PIL": "pillow",
    "ai_edge_litert": "ai-edge-litert",
    "cholespy": "cholespy",
    "cv2": "opencv-contrib-python-headless",
    "diffusers": "diffusers",
    "dlib": "dlib-bin",
    "gsplat": "gsplat",
    "igl": "libigl",
    "matplotlib": "matplotlib",
    "numba": "numba",
    "numpy": "numpy",
    "open_clip": "open_clip_torch",
    "pandas": "pandas",
    "scipy": "scipy",
    "timm": "timm",
    "torch": "torch",
    "torchmetrics": "torchmetrics",
    "torchvision": "torchvision",
    "transformers": "transformers",
    "trimesh": "trimesh",
}
"""Packages whose version may change a result, by the name that modules import. Optional ones choose a solver."""


def fingerprint(module: str, without: Collection[str] = ()) -> str:
    """Digest of a module and of all modules of this project that it imports, directly or indirectly.

    Comments, layout and docstrings do not count.

    Args:
        module: Name of the module, such as `carigs.stages.train`.
        without: Packages of this project that do not count, such as `carigs.toy`.

    Returns:
        Sixteen hexadecimal digits.

    Raises:
        ModuleNotFoundError: The project has no such module.
    """
    return sha256("\n".join(map(_digest, sources(module, without))).encode()).hexdigest()[:16]


def sources(module: str, without: Collection[str] = ()) -> list[Path]:
    """Files of a module and of all modules of this project that it imports, inside functions too.

    Data and templates beside a module under its name (`weights.toml` of `weights.py`) belong to it. A package's
    `__init__` counts only if something is imported from the package itself.

    Args:
        module: Name of the module.
        without: Packages of this project that do not count.

    Returns:
        Sorted paths.

    Raises:
        ModuleNotFoundError: The project has no such module.
    """
    return sorted({file for source in _modules(module, without) for file in (source, *_data(source))})


def package_versions(module: str, without: Collection[str] = ()) -> dict[str, str]:
    """Versions of the packages that a module and the modules of this project that it imports depend on.

    Args:
        module: Name of the module.
        without: Packages of this project that do not count.

    Returns:
        The version of each package of `DISTRIBUTIONS` that is imported, empty if it is not installed; by the name that
        modules import.

    Raises:
        ModuleNotFoundError: The project has no such module.
    """
    names = {name for source in _modules(module, without) for name in _source(source).packages}
    return {name: _version(DISTRIBUTIONS[name]) for name in sorted(names & DISTRIBUTIONS.keys())}


def newest_source() -> int:
    """When a file of this project was changed last.

    Returns:
        Modification time in nanoseconds since 1970.
    """
    newest = 0
    for package in PACKAGES:
        for directory, folders, files in os.walk(ROOT / package):
            folders[:] = [name for name in folders if name != "__pycache__"]
            newest = max([newest, *(os.stat(os.path.join(directory, name)).st_mtime_ns for name in files)])
    return newest


def _modules(module: str, without: Collection[str]) -> set[Path]:
    file = _file(module)
    if file is None:
        raise ModuleNotFoundError(f"carigs and evaluation have no module {module}")
    left_out = {ROOT.joinpath(*name.split(".")) for name in without}
    files: set[Path] = set()
    pending = [file]
    while pending:
        file = pending.pop()
        if file not in files and left_out.isdisjoint(file.parents):
            files.add(file)
            pending += _source(file).modules
    return files


def _file(module: str) -> Path | None:
    """The file of a module of `FOLDERS`; None for other modules and for names that are not modules."""
    package, *_ = names = module.split(".")
    if package not in FOLDERS:
        return None
    path = ROOT.joinpath(FOLDERS[package], *names)
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if file.is_file()), None)


@cache
def _digest(file: Path) -> str:
    return _source(file).digest if file.suffix == ".py" else sha256(file.read_text("utf-8").encode()).hexdigest()


class _Source(NamedTuple):
    """What matters of a module."""

    digest: str
    """Of its syntax tree without docstrings."""
    modules: tuple[Path, ...]
    """Files of this project that it imports."""
    packages: frozenset[str]
    """First parts of the names of all modules that it imports."""


# A workflow asks for the fingerprints of thirty modules, which share most of their sources.
@cache
def _source(file: Path) -> _Source:
    try:
        tree, names = ast.parse(file.read_bytes()), []
    except SyntaxError as error:
        raise CarigsError(f"{file}: line {error.lineno}: {error.msg}") from error
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):  # relative imports are not used
            names += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            # Also the strings below fields and constants, which are their documentation.
            node.body = [line for line in node.body if not _is_text(line)]
    files = [_file(name) for name in names if name.startswith((*FOLDERS,)) and not name.startswith(WITHOUT_EFFECT)]
    return _Source(
        sha256(ast.dump(tree).encode()).hexdigest(),
        tuple(file for file in files if file),
        frozenset(name.partition(".")[0] for name in names),
    )


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)


@cache
def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


@cache
def _data(file: Path) -> tuple[Path, ...]:
    return tuple(data for data in file.parent.glob(f"{file.stem}.*") if data.suffix in DATA)
