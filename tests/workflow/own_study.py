"""A study and a subject of a user."""

from __future__ import annotations

from pathlib import Path

OWN = {
    "study/tiny": """# @package _global_
study: {name: tiny, subjects: [anna], variants: [alternating, surfhead], levels: [0, 0.25]}
train: {iterations: 12}
render: {orbit_frames: 2}
tabulate: {resamples: 50}
figures: {blend_error_samples: 3}
""",
    "subject/anna": """# @package _global_
capture:
  toy: {seed: 7, width: 64, height: 84, cameras: 3, steps_per_sequence: 1, supersampling: 1, texture_size: 128}
""",
}
"""Text of each file of `conf`, by its path without suffix."""


def write_own_study(folder: Path) -> None:
    """Write the study and the subject of a user to the folder `conf`."""
    for name, text in OWN.items():
        file = folder / f"conf/{name}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
