"""The examples of docs/library.md run, one after the other, on a small avatar."""

import re
from pathlib import Path

import numpy as np
import pytest
from avatars import ball_avatar

from carigs.splat.avatar import save_avatar

TEXT = (Path(__file__).parents[2] / "docs/library.md").read_text("utf-8")


def test_the_python_examples_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_avatar(tmp_path / "avatar.npz", ball_avatar())
    blocks, names = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL), {}
    assert len(blocks) >= 5
    for block in blocks:
        exec(block, names)
    assert names["image"].shape == (256, 256, 3) and len(names["images"]) == 4
    assert np.isfinite(names["caricature"]).all()
    assert np.abs(names["caricature"] - names["vertices"]).max() > 0.01


@pytest.mark.parametrize("line", re.findall(r"^carigs export (.*?)(?:  +#.*)?$", TEXT, re.MULTILINE))
def test_the_commands_are_valid(line, tmp_path, monkeypatch):
    from carigs.cli import export

    monkeypatch.chdir(tmp_path)
    tasks = []
    monkeypatch.setattr(export, "export", tasks.append)
    assert export.main(line.replace("\n", " ").split()) == 0
    assert tasks[0].avatar == Path("avatar.npz")
