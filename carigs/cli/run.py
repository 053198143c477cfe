"""`carigs run`: have Snakemake make a study in the current directory."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Sequence

from carigs.cli.parser import study_parser
from carigs.config import compose_study, project_root

EXAMPLES = """examples:
  carigs run                                            the toy study, on all cores
  carigs run study=ict train.iterations=2000 --cores 4
  carigs run study=mine --dry-run                       what would be made; conf/study/mine.yaml is your own file
  carigs run -- --keep-going                            options of Snakemake after --
"""


def run_parser(command: str, description: str, examples: str) -> argparse.ArgumentParser:
    """The options that `run` and `sweep` share.

    Args:
        command: Name of the subcommand.
        description: What it does.
        examples: Shown after the options.

    Returns:
        The parser; use it with `parse_run`.
    """
    usage = "[--cores N] [--dry-run] [--profile FOLDER] [--target T] [-- ...]"
    parser = study_parser(command, description, examples, usage)
    parser.add_argument("-c", "--cores", metavar="N", help="CPU cores (default: all, or what --profile says)")
    parser.add_argument("-n", "--dry-run", action="store_true", help="print what would be made, make nothing")
    parser.add_argument("--profile", metavar="FOLDER", help="workflow profile of Snakemake, such as slurm")
    parser.add_argument("--target", action="append", metavar="T", help="rule or file (default: reproduce and table)")
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


def make_study(overrides: Sequence[str], options: argparse.Namespace) -> bool:
    """Run Snakemake on the composed study; results are written to `results/` in the current directory.

    Args:
        overrides: Hydra overrides.
        options: As returned by `parse_run`.

    Returns:
        Whether Snakemake succeeded.

    Raises:
        SettingsError: For wrong overrides, before Snakemake starts.
    """
    compose_study(*overrides)
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(project_root() / "Snakefile")]
    command += ["--workflow-profile", options.profile or str(project_root() / "profiles/default")]
    # On a cluster, cores of this machine would limit the threads of jobs.
    cores = options.cores or ("" if options.profile else "all")
    command += ["--cores", cores] if cores else []
    command += ["--dry-run"] * options.dry_run + options.snakemake
    command += ["--config", f"hydra={hydra_line(overrides)}", "--", *(options.target or ("reproduce", "table"))]
    return _exit_code(command) == 0


def _exit_code(command: list[str]) -> int:
    """The exit code of Snakemake; after Ctrl-C it gets the time to stop or cancel its jobs."""
    with subprocess.Popen(command) as snakemake:
        try:
            return snakemake.wait()
        except KeyboardInterrupt:
            snakemake.wait()
            raise


def hydra_line(overrides: Sequence[str]) -> str:
    """Join overrides for Snakemake's `--config hydra=`.

    Args:
        overrides: Hydra overrides.

    Returns:
        The line that `carigs.config.split_overrides` splits again. Backslashes, because Snakemake removes quotes at the
        ends of a value; the blanks keep a last one. (A value of nothing but blanks is an error of Snakemake's parser.)
    """
    return "".join(re.sub(r"([\s'\"\\])", r"\\\1", override) + " " for override in overrides)


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = run_parser("run", "Make the avatars, the table and the figures of a study in ./results.", EXAMPLES)
    options = parse_run(parser, arguments)
    return 0 if make_study(options.overrides, options) else 1
