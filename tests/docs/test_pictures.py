"""The list of the pictures of the documents, docs/images/commands.toml, and `make gallery`, which runs it."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from docs.blocks import ROOT, command_lines
from docs.commands import parse, unknown_keys
from PIL import Image

from carigs.errors import InputError
from evaluation.figures.data_flow import drawing, read_links, without_detours
from evaluation.figures.make_gallery import Picture, make_pictures, read_pictures, write_resized

pytestmark = pytest.mark.docs
LIST = ROOT / "docs/images/commands.toml"
PICTURES = read_pictures(LIST)
IMAGES = {".png", ".webp", ".gif", ".jpg", ".svg"}


def test_every_picture_is_listed_once_and_every_listed_one_is_there():
    there = [file for folder in ("docs/images", "docs/results") for file in (ROOT / folder).rglob("*")]
    names = sorted(file.relative_to(ROOT).as_posix() for file in there if file.suffix in IMAGES)
    assert sorted(picture.file for picture in PICTURES) == names


def test_every_picture_is_shown_by_a_document():
    shown = {
        (document.parent / link).resolve()
        for document in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
        for link in re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", document.read_text("utf-8"))
    }
    assert [picture.file for picture in PICTURES if ROOT / picture.file not in shown] == []


@pytest.mark.parametrize("command", sorted({picture.command for picture in PICTURES}))
def test_the_commands_exist(command, monkeypatch):
    for program, *words in command_lines(command):
        if program == "carigs":
            assert unknown_keys(getattr(parse(words, monkeypatch), "overrides", [])) == []
        elif program == "python":
            assert words[0] == "-m" and (ROOT / f"{words[1].replace('.', '/')}.py").is_file()
        else:
            assert program == "snakemake"


def test_the_drawing_of_the_stages_is_that_of_the_present_workflow(tmp_path):
    make = [sys.executable, "-m", "snakemake", "--quiet", "all", "--rulegraph", "--", "reproduce", "table"]
    graph = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    links = without_detours({("dataset", "capture"), *read_links(graph)})
    assert (ROOT / "docs/images/data_flow.svg").read_text("utf-8") == drawing(links)


def test_commands_run_once_and_pictures_without_their_data_are_left(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HEADS", str(tmp_path))
    Image.new("RGB", (40, 20), "red").save("red.png")
    copy = "echo run >> runs; cp red.png {scratch}/copy.png"
    pictures = [
        Picture("a.webp", copy, made="{scratch}/copy.png", width=20),
        Picture("b.png", copy, made="{scratch}/copy.png", width=80, needs=("$HEADS/red.png",)),
        Picture("c.png", "cp red.png {file}", needs=("$HEADS/blue.png",)),
    ]
    assert make_pictures(pictures)
    assert (tmp_path / "runs").read_text() == "run\n"
    sizes = []
    for file in ("a.webp", "b.png"):
        with Image.open(file) as image:
            sizes.append(image.size)
    assert sizes == [(20, 10), (40, 20)]
    assert not (tmp_path / "c.png").exists()
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["a.webp: made", "b.png: made"]
    assert "missing: $HEADS/blue.png" in lines[2]


def test_a_command_that_fails_is_told_and_leaves_the_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (4, 4)).save("a.png")
    before = (tmp_path / "a.png").read_bytes()
    assert not make_pictures([Picture("a.png", "false", made="b.png"), Picture("c.png", "touch {file}")])
    assert (tmp_path / "a.png").read_bytes() == before and (tmp_path / "c.png").exists()
    assert "a.png: not made; failed: false" in capsys.readouterr().out


@pytest.mark.parametrize("entry", ['fiel = "a.png"', 'file = "a.png"', 'file = "a"\ncommand = "b"\nmaid = "c"'])
def test_a_wrong_entry_names_the_list(entry, tmp_path):
    (tmp_path / "list.toml").write_text(f"[[picture]]\n{entry}\n")
    with pytest.raises(InputError, match=r"list\.toml"):
        read_pictures(tmp_path / "list.toml")


def test_a_converted_picture_keeps_its_colours(tmp_path):
    Image.new("RGBA", (30, 30), (255, 0, 0, 255)).save(tmp_path / "red.png")
    write_resized(tmp_path / "red.png", tmp_path / "red.webp", 10)
    with Image.open(tmp_path / "red.webp") as image:
        red, green, blue = image.convert("RGB").getpixel((5, 5))
        assert image.size == (10, 10)
    assert red > 240 and max(green, blue) < 15
