"""The commands of README.md and of the tutorials run, in a miniature; those that cannot run here are parsed.

`substitutions.py` states what is changed before a block runs.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from docs.blocks import DOCUMENTS, LANGUAGES, ROOT, SHELL, Block, command_lines, parse_blocks, read_blocks
from docs.captures import write_captures, write_mesh_with_regions
from docs.commands import known_keys, parse, unknown_keys
from docs.substitutions import CONTINUED, PARTLY, STUDY, SUBSTITUTIONS, substituted

from carigs.config import split_overrides

pytestmark = pytest.mark.docs
BLOCKS = [block for document in DOCUMENTS for block in read_blocks(document)]
COMMAND_LINES = [
    (block, words)
    for block in BLOCKS
    if block.language in SHELL
    for words in command_lines(block.script)
    if words[0] in ("carigs", "snakemake")
]
RESULT = re.compile(r"results/[^\s:]+")
KEPT = 'export -p > "$STATE/variables"; pwd > "$STATE/folder"'
"""End of each script: the next one starts with the variables and in the folder that this one left."""


def name_of(document: Path) -> str:
    return document.relative_to(ROOT).as_posix()


class Reader:
    """Someone who types the blocks of a document, one after the other, in one terminal and one Python session."""

    def __init__(self, folder: Path, made: Path | None = None):
        self.data, self.state, self.names = folder / "captures", folder / "state", {}
        self.made = made or folder / "made"
        home = folder / "home"
        for new in (self.data, self.state, home):
            new.mkdir()
        write_captures(self.data)
        write_mesh_with_regions(home)
        (self.state / "folder").write_text(str(home))
        (self.state / "variables").write_text("")

    @property
    def folder(self) -> Path:
        """The current directory of the terminal."""
        return Path((self.state / "folder").read_text().strip())

    def run(self, block: Block) -> None:
        """Run a block; fails with all that it says."""
        document = name_of(block.document)
        if block.language == "python":
            exec(compile(block.text, str(block), "exec"), self.names)
            return
        script = substituted(block.script, document, str(self.data))
        programs = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", f'. "$STATE/variables"\n{script}\n{KEPT}'],
            cwd=self.folder,
            env={
                **os.environ,
                "PYTHONPATH": str(ROOT),
                "PATH": programs,
                "STATE": str(self.state),
                "MADE": str(self.made),
            },
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{block}\n{script}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder for results of documents, by name of the document, where others find them."""
    return tmp_path_factory.mktemp("made")


@pytest.mark.slow
@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_the_blocks_of_a_document_run_one_after_the_other(document, made, tmp_path, monkeypatch):
    reader = Reader(tmp_path, made)
    for block in read_blocks(document):
        if block.language in (*SHELL, "python") and block.reason is None:
            monkeypatch.chdir(reader.folder)
            reader.run(block)
    shown = [RESULT.findall(block.text) for block in read_blocks(document) if block.language == "text"]
    promised = {name for names in shown for name in names if "..." not in name}
    assert sorted(name for name in promised if not (reader.folder / name).exists()) == []
    if name_of(document) in {other for _, _, other in CONTINUED}:
        shutil.copytree(reader.folder / "results", made / name_of(document))


def test_a_reader_stays_in_one_terminal_and_sees_what_fails(tmp_path, monkeypatch):
    def block(language: str, text: str) -> Block:
        return Block(ROOT / "README.md", 1, language, text, None)

    reader = Reader(tmp_path)
    reader.run(block("sh", "export A='1 2'\nmkdir place && cd place\n"))
    reader.run(block("console", "$ test \"$A\" = '1 2'\nan output\n$ touch here\n"))
    assert (tmp_path / "home/place/here").exists()
    monkeypatch.chdir(reader.folder)
    reader.run(block("python", "from pathlib import Path\nplace = Path('here')\n"))
    reader.run(block("python", "assert place.exists()\n"))
    for text in ("false\ntrue\n", "false | true\n", "carigs walk\n", 'test "$B"\n'):
        with pytest.raises(AssertionError, match=r"README\.md:1"):
            reader.run(block("sh", text))
    with pytest.raises(NameError):
        reader.run(block("python", "elsewhere"))


def test_every_document_has_blocks_that_run():
    running = {block.document for block in BLOCKS if block.language in (*SHELL, "python") and block.reason is None}
    assert running == {*DOCUMENTS}


@pytest.mark.parametrize("block", BLOCKS, ids=str)
def test_a_block_names_its_language_and_why_it_is_not_run(block):
    assert block.language in LANGUAGES
    assert block.reason is None or block.reason
    assert block.reason is None or block.language in (*SHELL, "python")


@pytest.mark.parametrize(("block", "words"), COMMAND_LINES, ids=lambda value: str(value)[-60:])
def test_commands_have_options_and_settings_that_exist(block, words, monkeypatch):
    if words[0] == "snakemake":
        overrides = [split_overrides(word.removeprefix("hydra=")) for word in words if word.startswith("hydra=")]
        assert unknown_keys([key for line in overrides for key in line]) == []
        return
    parsed = parse(words[1:], monkeypatch)
    assert unknown_keys(getattr(parsed, "overrides", [])) == []


def test_a_wrong_command_a_wrong_option_and_a_wrong_setting_are_found(monkeypatch, capsys):
    with pytest.raises(AssertionError, match="walk"):
        parse(["walk"], monkeypatch)
    with pytest.raises(SystemExit):
        parse(["run", "--coers", "2"], monkeypatch)
    assert "--coers" in capsys.readouterr().err
    assert parse(["run", "--cores", "2", "gamma=0.2", "--", "--verbose"], monkeypatch).overrides == ["gamma=0.2"]
    assert unknown_keys(["study=paper", "train.iteration=3", "train.iterations=3"]) == ["train.iteration=3"]


@pytest.mark.parametrize("setting", re.findall(r"`((?:\w+\.)+\w+|gamma|preset)=", "".join(
    document.read_text("utf-8") for document in DOCUMENTS
)))  # fmt: skip
def test_settings_in_the_text_exist(setting):
    assert setting in known_keys()


def test_every_substitution_is_used():
    """One that changes nothing is left over from a text that has changed."""
    texts = {name_of(block.document): "" for block in BLOCKS}
    for block in BLOCKS:
        texts[name_of(block.document)] += block.script if block.language in SHELL and block.reason is None else ""
    for pattern, _ in SUBSTITUTIONS:
        assert any(re.search(pattern, text) for text in texts.values()), pattern
    for document, command, _ in (*PARTLY, *CONTINUED):
        assert command in texts[document]
    assert unknown_keys([f"{key}=" for key in STUDY]) == []


def test_a_substituted_command_keeps_what_was_typed():
    typed = "carigs run study=own capture.folder=/data/anna train.iterations=2000"
    run = substituted(typed, "docs/tutorials/own-capture.md", "captures")
    assert "capture.folder=captures/anna" in run and "study=own" in run
    assert (
        run.count("train.iterations=") == run.count("train.iterations=20 ") + run.endswith("train.iterations=20") == 1
    )
    assert "train.iterations=20,30" in substituted("carigs sweep train.iterations=500,1500", "README.md", "captures")
    assert "--dry-run" in substituted(typed, "README.md", "captures")


DOCUMENT = """
<!-- not run: needs a cluster -->
```sh
srun carigs run   # a comment
```

```console
$ A=1 carigs check x && carigs plan \\
$   --nodes 2
all is well
```

- list

  ```text
  output
  ```
"""


def test_blocks_are_parsed():
    first, second, third = parse_blocks(ROOT / "README.md", DOCUMENT)
    assert (first.language, first.reason, first.line) == ("sh", "needs a cluster", 3)
    assert (second.reason, third.text) == (None, "output\n")
    assert list(command_lines(first.script)) == [["srun", "carigs", "run"]]
    assert list(command_lines(second.script)) == [["carigs", "check", "x"], ["carigs", "plan", "--nodes", "2"]]
    with pytest.raises(AssertionError, match="not closed"):
        parse_blocks(ROOT / "README.md", "```sh\ncarigs run\n")
    here = "cat > file << 'END'\ncarigs walk\nEND\ncarigs run\n"
    assert [words[0] for words in command_lines(here)] == ["cat", "carigs"]
