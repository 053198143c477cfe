"""The rooms of the code: in the import contract and in CONTRIBUTING.md, in one order."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST_FILES = 20
MOST_LINES = 300
LONG_MODULES = {
    "carigs/simd/ir_values.py": "LLVM's values and arrays: one class each, with an operator per method",
    "carigs/splat/rig/rig.py": "the rig and the motion of its triangles, which share records and kernels",
    "carigs/toy/shape/edge_operations.py": "split, collapse, flip and relax, which change one data structure",
    "carigs/viewer/panel.py": "every control of the page",
}
"""Modules that hold one concept and are longer, with the reason. A new one is split rather than added."""


def layers() -> list[str]:
    """Rooms in the import contract, the lowest first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    return next(contract["layers"] for contract in contracts if contract["type"] == "layers")[::-1]


def test_every_room_is_in_the_import_contract():
    places = {path.stem for path in (ROOT / "carigs").iterdir() if path.suffix in ("", ".py")} - {"__pycache__"}
    assert {f"carigs.{name}" for name in places - {"__init__", "__main__", "_project"}} == {*layers()} - {"evaluation"}


def test_the_rooms_of_the_guide_are_those_of_the_contract():
    rows = re.findall(r"^\| `((?:carigs|evaluation)[\w/.]*)` \|", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert [row.removesuffix(".py").rstrip("/").replace("/", ".") for row in rows] == layers()


def test_a_folder_can_be_looked_through():
    folders = {file.parent for package in ("carigs", "evaluation") for file in (ROOT / package).rglob("*.py")}
    counts = {str(folder.relative_to(ROOT)): len([*folder.glob("*.py")]) for folder in folders}
    assert {folder: count for folder, count in counts.items() if count > MOST_FILES} == {}


def test_a_module_holds_one_concept():
    files = [file for room in ("carigs", "evaluation") for file in (ROOT / room).rglob("*.py")]
    lengths = {file.relative_to(ROOT).as_posix(): file.read_text("utf-8").count("\n") for file in files}
    long = {name for name, length in lengths.items() if length > MOST_LINES}
    assert long - LONG_MODULES.keys() == set()
    assert LONG_MODULES.keys() - long - {"carigs/viewer/panel.py"} == set(), "short enough now: take it off the list"
