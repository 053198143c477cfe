"""A study that runs in seconds: the miniature subject of `miniature.write_ball`, one variant, few training steps.

The environment variable CARIGS_CLUSTER_STUDY names another one: "study=toy train.iterations=12".
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from miniature import write_ball
from project import Project

STUDY = """# @package _global_
study: {name: ball, subjects: [ball], variants: [alternating], levels: [0, 0.25]}
train: {iterations: 40}
render: {orbit_frames: 2}
"""
SUBJECT = """# @package _global_
capture: {{source: folder, folder: {folder}, head_model: {folder}/head_model.npz}}
"""
HYDRA = os.environ.get("CARIGS_CLUSTER_STUDY", "study=ball")
NAME = re.search(r"study=(\w+)", HYDRA)[1]
"""Of the study, and of its first subject."""
RESULTS = ("table/*", "**/path.npz", "**/avatar.npz", "**/metrics.csv", "**/*.png")
"""Patterns of the files that are the same wherever they are made."""


def write_ball_study(project: Project) -> None:
    """Write the capture of the subject beside the project's results, and the study's configuration."""
    folder = write_ball(project.root / "captures/ball")
    (project.root / "conf/study/ball.yaml").write_text(STUDY)
    (project.root / "conf/subject/ball.yaml").write_text(SUBJECT.format(folder=folder))


def contents(results: Path) -> dict[str, bytes]:
    """Contents of the results, by path."""
    files = {file for pattern in RESULTS for file in results.glob(pattern) if file.is_file()}
    return {file.relative_to(results).as_posix(): file.read_bytes() for file in sorted(files)}
