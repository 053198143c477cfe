"""A study and a subject of a user."""

from __future__ import annotations

from pathlib import Path

OWN = {
    "study/small": """# @package _global_
study: {name: small, subjects: [anna], variants: [alternating, surfhead], levels: [0, 0.25]}
train: {iterations: 600, density: {stop: 2000}}
render: {orbit_frames: 2}
""",
    "subject/anna": """# @package _global_
capture:
  toy: {width: 104, height: 136, cameras: 5, steps_per_sequence: 1, texture_size: 384, hair_strands: 2500}
""",
}
"""Text of each file of `conf`, by its path without suffix."""


def write_own_study(folder: Path) -> None:
    """Write the study and the subject of a user to the folder `conf`."""
    for name, text in OWN.items():
        file = folder / f"conf/{name}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
