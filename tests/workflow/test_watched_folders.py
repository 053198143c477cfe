"""A rule that reads an index of files also watches their folder: an index can stay the same while its images change."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

RULES = Path(__file__).parents[2] / "workflow/rules"
DATA_FLOW = ("avatar.smk", "evaluate.smk")
"""The rules of the stages; cards and reports read of an index only what it says itself."""
INPUTS = {
    name: inputs
    for file in DATA_FLOW
    for name, inputs in re.findall(
        r"^rule (\w+):\n    input:\n(.*?)^    \w", (RULES / file).read_text("utf-8"), re.S | re.M
    )
}
"""The text of the inputs of each rule."""
WATCHED = {"capture.json": "dataset", "targets.json": "images", "truth.json": "frames"}
"""Each index, and the folder beside it whose files it lists."""


@pytest.mark.parametrize("index", WATCHED)
def test_who_reads_an_index_watches_its_folder(index):
    readers = {name: re.findall(rf'"(results/\S*/){re.escape(index)}"', inputs) for name, inputs in INPUTS.items()}
    assert sum(map(len, readers.values())) > 0
    for name, folders in readers.items():
        for folder in folders:
            assert f'"{folder}{WATCHED[index]}"' in INPUTS[name], f"rule {name}: {folder}{index}"
