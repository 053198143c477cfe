"""The fenced blocks of a document: which language they are in, and why some of them are not run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs/tutorials").glob("*.md"))]
SHELL = ("sh", "console")
LANGUAGES = (*SHELL, "python", "text", "json", "yaml")
"""What a fence may name. A block without a language would be neither run nor checked."""
NOT_RUN = re.compile(r"<!-- not run:(.*)-->")
FENCE = re.compile(r"( *)```(.*)")
HERE_DOCUMENT = re.compile(r"<< *'?(\w+)'?")


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        document: File that it is in.
        line: Number of the line of its fence.
        language: What the fence names.
        text: The lines between the fences.
        reason: Why it is not run; None if it is.
    """

    document: Path
    line: int
    language: str
    text: str
    reason: str | None

    def __str__(self) -> str:
        return f"{self.document.relative_to(ROOT).as_posix()}:{self.line}"

    @property
    def script(self) -> str:
        """What a shell runs: of a console, the lines after the prompt."""
        if self.language != "console":
            return self.text
        return "".join(line[2:] for line in self.text.splitlines(True) if line.startswith("$ "))


def parse_blocks(document: Path, text: str) -> list[Block]:
    """Find the fenced blocks of a document; `<!-- not run: REASON -->` stands on the line before a fence."""
    blocks, lines, i = [], text.splitlines(), 0
    while i < len(lines):
        opening = FENCE.fullmatch(lines[i])
        if opening is None:
            i += 1
            continue
        end = next((j for j in range(i + 1, len(lines)) if lines[j].strip() == "```"), None)
        assert end is not None, f"{document}:{i + 1}: the fence is not closed"
        comment = NOT_RUN.fullmatch(lines[i - 1].strip()) if i else None
        content = "".join(line.removeprefix(opening[1]) + "\n" for line in lines[i + 1 : end])
        blocks.append(Block(document, i + 1, opening[2], content, comment and comment[1].strip()))
        i = end + 1
    return blocks


def read_blocks(document: Path) -> list[Block]:
    """The fenced blocks of a file."""
    return parse_blocks(document, document.read_text("utf-8"))


def command_lines(script: str) -> Iterator[list[str]]:
    """Split a shell script into the words of its commands, without comments and texts of here-documents.

    `cd a && carigs run` are two commands. Variables at the front, as in `NAME=value carigs run`, are left out.
    """
    lines = iter(script.replace("\\\n", " ").splitlines())
    for line in lines:
        words = shlex.split(line, comments=True)
        if here := HERE_DOCUMENT.search(line):
            for text in lines:
                if text == here[1]:
                    break
        command: list[str] = []
        for word in [*words, "&&"]:
            if word in ("&&", "||", ";", "|"):
                while command and re.fullmatch(r"[A-Z_]+=.*", command[0]):
                    del command[0]
                if command:
                    yield command
                command = []
            else:
                command.append(word)
