"""What a block of the documents is changed to before it is run, so that the documents keep what a user types."""

from __future__ import annotations

import re

STUDY = {
    "study.variants": "[alternating]",
    "study.levels": "[0,0.25]",
    "capture.toy.width": "80",
    "capture.toy.height": "104",
    "capture.toy.cameras": "3",
    "capture.toy.steps_per_sequence": "1",
    "capture.toy.supersampling": "1",
    "capture.toy.texture_size": "128",
    "capture.toy.hair_strands": "300",
    "train.iterations": "20",
    "render.orbit_frames": "1",
    "metrics.embeddings": "[]",
    "metrics.lpips": "[]",
}
"""Settings of the miniature studies. One that the line of a document has is left out."""

SUBSTITUTIONS = (
    # what a user types, what runs here: the reason
    (r"/data/flame2023\.pkl", "{data}/flame2023.npz"),  # FLAME asks for a registration: the ball's head model
    (r"/data\b", "{data}"),  # the captures of `captures.py`
    (r"train\.iterations=\d+,[\d,]+", "train.iterations=20,30"),  # minutes of training
    (r"train\.iterations=\d+(?![\d,])", "train.iterations=20"),
    (r"carigs (run|sweep)\b", r"carigs \1 {study}"),  # a small toy, one variant, two levels
    (r"carigs export\b(?!.*\.html)", "carigs export --size 48 --seconds 0.2"),  # seconds of rendering
)
"""Pairs of a regular expression and its replacement, applied one after the other. `{data}` is a folder, `{study}` the
settings of `STUDY`."""

AVATAR = "results/toy/toy/gamma=0.25/alternating/seed=0/avatar.npz"
PARTLY = (
    # document, command, what is added to it: why
    ("README.md", "carigs run\n", f"--target {AVATAR}"),  # docs/tutorials/toy.md makes the whole study
    ("docs/tutorials/talk.md", "carigs run\n", f"--target {AVATAR}"),
    ("docs/tutorials/other-programs.md", "carigs run\n", f"--target {AVATAR}"),
    (  # what is trained on other targets is trained alike
        "docs/tutorials/stylizers.md",
        "carigs run study.variants",
        "--target results/toy/toy/gamma=0.0001/targets/alternating/level=0.0001/targets.json",
    ),
    (
        "docs/tutorials/stylizers.md",
        "carigs run study=paper_editing",
        "--target results/paper_editing/toy/gamma=0.25/drawn_nose/seed=0/metrics.csv",
    ),
    ("README.md", "carigs run study=own", "--dry-run"),  # as docs/tutorials/own-capture.md does
    ("docs/tutorials/toy.md", "carigs run gamma=0.35", "--dry-run"),  # the same stages as the run before
    (
        "docs/tutorials/gaussian-avatars.md",
        "carigs run study=own study.name=person306",
        "--dry-run",
    ),  # as own-capture.md
    (
        "docs/tutorials/gaussian-avatars.md",
        "carigs run study=own study.name=start306",
        "--target results/start306/own/gamma=0.25/alternating/seed=0/metrics.csv",
    ),  # own-capture.md makes the table, the figures and the report
)
"""Commands that do less here, to save time, because another document runs the same."""

CONTINUED = (
    ("docs/tutorials/toy.md", "carigs run\n", "README.md"),
    ("docs/tutorials/talk.md", "carigs run\n", "README.md"),
    ("docs/tutorials/other-programs.md", "carigs run\n", "README.md"),
)
"""Commands that find the results of a document that has run before, if it has: document, command, that document. The
run of README.md makes the toy's avatar from nothing, and that of the tutorial makes the rest."""


def substituted(script: str, document: str, data: str) -> str:
    """The script that is run in place of one of a document.

    Args:
        script: Text of the block.
        document: Path of the document below the root.
        data: Folder with the captures, which the documents call `/data`.

    Returns:
        The script.
    """
    return "".join(_substituted_line(line, document, data) for line in script.splitlines(True))


def _substituted_line(line: str, document: str, data: str) -> str:
    found = "".join(
        f'if [ -d "$MADE/{other}" ]; then cp -r "$MADE/{other}" results; fi\n'
        for where, command, other in CONTINUED
        if where == document and line == command
    )
    for where, command, option in PARTLY:
        if where == document and line.startswith(command):
            line = line.replace("carigs run", f"carigs run {option}", 1)
    study = " ".join(f"{key}={value}" for key, value in STUDY.items() if f"{key}=" not in line)
    for pattern, replacement in SUBSTITUTIONS:
        line = re.sub(pattern, replacement.replace("{data}", data).replace("{study}", study), line)
    return found + line
