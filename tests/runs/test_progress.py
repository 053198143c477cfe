"""A line per job."""

from __future__ import annotations

import io
import logging

from carigs.runs.progress import show_job_lines


def test_jobs_have_a_line_and_errors_stay(capsys, tmp_path):
    """Events and fields are those of Snakemake; that they are its present ones is tested with a study."""
    logger, terminal = logging.Logger("test", logging.INFO), io.StringIO()
    logger.addHandler(logging.StreamHandler(terminal))
    logger.addHandler(logging.FileHandler(tmp_path / "all.log", delay=False))
    show_job_lines(logger, 3, ("settings",))
    logger.info("Select jobs to execute...")
    logger.info("started", extra={"event": "job_info", "rule_name": "settings", "output": ["a.yaml"]})
    logger.info(None, extra={"event": "progress", "done": 1, "total": 3})
    logger.info("started", extra={"event": "job_info", "rule_name": "train", "output": ["a.npz", "b"]})
    logger.error("Error in rule train")
    assert capsys.readouterr().err.splitlines() == ["[1 of 3 done] starting train: a.npz"]
    assert terminal.getvalue().splitlines() == ["Error in rule train"]
    for handler in logger.handlers:
        handler.close()
    assert len((tmp_path / "all.log").read_text().splitlines()) == 5
