"""`carigs run`: have Snakemake make a study in the current directory."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Collection, Sequence
from pathlib import Path

from carigs.cli.options.parser import study_parser
from carigs.config import project_root, read_sweep, snakemake_config
from carigs.errors import print_line
from carigs.planning.study_subjects import check_subjects
from carigs.planning.study_weights import absent_lines, empty_records, fetch_weights, needed_weights
from carigs.runs.job_record import unfinished_jobs
from carigs.runs.snakemake_process import check_working_folder, snakemake_environment
from carigs.runs.summary import error_lines
from carigs.system.extras import need

EXAMPLES = """examples:
  carigs run                                            the toy study, on all cores
  carigs run study=ict train.iterations=2000 --cores 4
  carigs run study=mine --dry-run                       what would be made; conf/study/mine.yaml is your own file
  carigs run --dry-run -- --quiet host                  with a description of each job
  carigs run study=paper --weights                      with all network weights that its columns need
  carigs run -- --keep-going                            options of Snakemake after --
  carigs run -- --verbose                               with all that Snakemake says
"""
MAX_ERRORS = 20
"""Errors that are repeated after a run; each is in its log."""


def run_parser(command: str, description: str, examples: str) -> argparse.ArgumentParser:
    """The options that `run` and `sweep` share.

    Args:
        command: Name of the subcommand.
        description: What it does.
        examples: Shown after the options.

    Returns:
        The parser; use it with `parse_run`.
    """
    usage = "[--cores N] [--dry-run | --plan] [--profile FOLDER] [--target T] [--weights] [-- ...]"
    parser = study_parser(command, description, examples, usage)
    parser.add_argument("-c", "--cores", metavar="N", help="CPU cores (default: all, or what --profile says)")
    parser.add_argument("-n", "--dry-run", action="store_true", help="print what would be made, make nothing")
    parser.add_argument("--plan", action="store_true", help="print how long it will take on this machine, make nothing")
    parser.add_argument("--profile", metavar="FOLDER", help="workflow profile of Snakemake, such as slurm")
    parser.add_argument("--weights", action="store_true", help="first download the network weights that it needs")
    parser.add_argument("--target", action="append", metavar="T", help="rule or file (default: all results)")
    return parser


def parse_run(parser: argparse.ArgumentParser, arguments: list[str]) -> argparse.Namespace:
    """Parse a command line of `run` or `sweep`.

    Args:
        parser: As made by `run_parser`.
        arguments: The command line; Snakemake's own options follow `--`.

    Returns:
        The overrides and options; `snakemake` holds the arguments after `--`.
    """
    end = arguments.index("--") if "--" in arguments else len(arguments)
    options = parser.parse_intermixed_args(arguments[:end])
    options.snakemake = arguments[end + 1 :]
    return options


def make_studies(
    overrides: Sequence[str], swept: Sequence[str], studies: Collection[str], options: argparse.Namespace
) -> tuple[bool, list[Path]]:
    """Run Snakemake on composed studies; results are written to `results/` in the current directory.

    After a failure the errors of the jobs are the last lines on stderr.

    Args:
        overrides: Hydra overrides.
        swept: Hydra overrides with several values, if the run is a sweep.
        studies: Folders of the results below `results/`.
        options: As returned by `parse_run`.

    Returns:
        Whether Snakemake succeeded, and the logs of the jobs that did not.

    Raises:
        InputError: The current directory or the results cannot be written to, or weights are not those of the registry.
        WeightsMissing: Weights cannot be downloaded, with `--weights`.
        PackageMissing: Snakemake is not installed.
    """
    need("snakemake")
    if options.plan:
        from carigs.cli import plan  # with all that reads captures: half a second

        wanted = ["--remaining", "--cores", options.cores or str(os.cpu_count())]
        return plan.main([*overrides, *swept, *wanted]) == 0, []
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(project_root() / "Snakefile")]
    command += ["--workflow-profile", options.profile or str(project_root() / "profiles/default")]
    # On a cluster, cores of this machine would limit the threads of jobs.
    cores = options.cores or ("" if options.profile else "all")
    command += ["--cores", cores] if cores else []
    command += ["--keep-going"] if swept else []
    # A plan is the numbers of jobs and the reasons; Snakemake would describe each job in ten lines.
    command += ["--quiet", "rules", "host", "--dry-run"] * options.dry_run + options.snakemake
    # The combinations of a sweep rarely differ in this.
    needed = needed_weights(read_sweep(overrides, swept).combinations[0].overrides if swept else overrides)
    if options.weights and not options.dry_run:
        fetch_weights(needed)
    for line in absent_lines(needed):
        print_line(line)
    # What an earlier run has left empty for want of weights that are here now.
    if stale := [file for study in studies for file in empty_records(Path("results", study), needed)]:
        command += ["--forcerun", *map(str, stale)]
    targets = ["sweep"] if swept else ["reproduce", "table"]
    command += ["--config", *snakemake_config(overrides, swept), "--", *(options.target or targets)]
    check_working_folder([] if options.dry_run else [Path("results", study) for study in studies])
    started = time.time()
    if _exit_code(command) == 0:
        return True, []
    logs = [log for study in studies for log in unfinished_jobs(Path("results", study, "log"), started)]
    for line in error_lines(logs[:MAX_ERRORS]):
        print_line(line)
    return False, logs


def _exit_code(command: list[str]) -> int:
    """The exit code of Snakemake; after Ctrl-C it gets the time to stop or cancel its jobs."""
    with subprocess.Popen(command, env=snakemake_environment()) as snakemake:
        try:
            return snakemake.wait()
        except KeyboardInterrupt:
            snakemake.wait()
            raise


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = run_parser("run", "Make the avatars, the table and the figures of a study in ./results.", EXAMPLES)
    options = parse_run(parser, arguments)
    study = check_subjects(options.overrides)
    succeeded, _ = make_studies(options.overrides, [], [study], options)
    return 0 if succeeded else 1
