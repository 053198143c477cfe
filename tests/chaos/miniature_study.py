"""A study of the miniature subject with the real stages that takes as little time as possible."""

from __future__ import annotations

from pathlib import Path

from miniature import write_ball
from project import Project, copy_project

STUDY = """# @package _global_
study: {name: mini, subjects: [ball], variants: [alternating], levels: [0]}
train: {iterations: 12, density: {stop: 8}}
render: {orbit_frames: 1}
"""
SUBJECT = """# @package _global_
capture: {source: folder, folder: data, head_model: data/head_model.npz}
"""
TARGETS = ("reproduce", "table")
HYDRA = "study=mini"


def copy_miniature_study(folder: Path) -> Project:
    """The project, the capture of the ball and its study, in a folder."""
    folder.mkdir(parents=True)
    project = copy_project(folder)
    (folder / "conf/study/mini.yaml").write_text(STUDY)
    (folder / "conf/subject/ball.yaml").write_text(SUBJECT)
    write_ball(folder / "data", timesteps=3)
    return project
