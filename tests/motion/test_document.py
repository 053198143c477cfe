"""The example of docs/motions.md runs."""

import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[2] / "docs/motions.md").read_text("utf-8")


@pytest.mark.filterwarnings("ignore:.*does not have", "ignore:.*left out")
def test_the_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    exec(block, {})
    assert capsys.readouterr().out.startswith("119 (")


def test_the_options_are_those_of_the_command(capsys):
    from carigs.cli.main import main

    with pytest.raises(SystemExit):
        main(["motion", "--help"])
    known = capsys.readouterr().out
    table = TEXT[TEXT.index("## Edits") :]
    options = set(re.findall(r"`(--[a-z]+)", table))
    assert len(options) >= 7 and all(option in known for option in options)
