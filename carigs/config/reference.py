"""The choices that come with carigs, by configuration group: what docs/configuration.md says of `conf/`."""

from __future__ import annotations

from collections.abc import Iterator

from carigs.config.folders import CONF, GROUPS
from carigs.config.mask_variants import MASK_VARIANTS

_HEADER = """## Presets

Files of `conf/` that come with carigs. `study=`, `preset=` and `exaggerate=` are chosen on the command line; subjects
and variants by `study.subjects` and `study.variants`. The variants `no_FLAG_mask` and `FLAG_mask` need no file.
"""
_MEANINGS = {
    "study": "subjects, variants, levels and settings that make one table",
    "preset": "time against quality, for any study",
    "subject": "one person's capture",
    "variant": "how an avatar is trained",
    "exaggerate": "how the caricature is solved",
}


def markdown() -> str:
    """Tables of the choices of every group.

    Returns:
        Markdown, the last part of docs/configuration.md.
    """
    return "\n".join([_HEADER, *(line for group in GROUPS for line in _table(group))]) + "\n"


def purpose(text: str) -> str:
    """What a file of `conf/` is for.

    Args:
        text: Its text.

    Returns:
        The first sentence of the comment that it starts with; empty if there is none.
    """
    comment = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line and not line.startswith("#   "):  # a command is indented
            comment.append(line.removeprefix("#").strip())
    sentence, _, _ = " ".join(comment).partition(". ")
    return sentence.rstrip(".:")


def _table(group: str) -> Iterator[str]:
    """A heading, and a row for each file."""
    yield f"### `{group}`: {_MEANINGS[group]}\n"
    yield "| name | what it is |"
    yield "|---|---|"
    texts = {file.stem: file.read_text("utf-8") for file in (CONF / group).glob("[!_]*.yaml")}
    for name, text in sorted({**texts, **(MASK_VARIANTS if group == "variant" else {})}.items()):
        meaning = purpose(text).replace("|", "\\|").replace("*", "\\*")
        yield f"| `{name}` | {meaning} |"
    yield ""
