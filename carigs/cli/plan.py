"""`carigs plan`: what a study will cost, before it starts."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from carigs.cli.run import OVERRIDES_HELP, hydra_line
from carigs.config import compose, compose_study, project_root
from carigs.planning.costs import REFERENCE_SPEED, all_seconds, earlier_times, job_bytes, speed_test
from carigs.planning.footage import Footage, subject_footage
from carigs.planning.job_graph import Job, study_jobs
from carigs.planning.schedule import Schedule, critical_path, list_schedule

DESCRIPTION = """Print the jobs of a study, their hours, memory and disk, and the time on a number of nodes.

Times come from an earlier run in this directory where there was one, else from a table of costs that was measured on
another machine and is scaled by a short test of this one. The schedule is simulated.
"""
EXAMPLES = """examples:
  carigs plan                                   the toy study on one node with two cores
  carigs plan study=paper --nodes 8 --cores 16
  carigs plan study=ict --remaining             only what has not been made yet
  carigs plan study=paper --json
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = argparse.ArgumentParser(
        "carigs plan",
        usage="carigs plan [KEY=VALUE ...] [--nodes N] [--cores N] [--memory MB] [--remaining] [--json]",
        description=DESCRIPTION,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help=OVERRIDES_HELP)
    parser.add_argument("--nodes", type=_positive, default=1, metavar="N", help="nodes (default %(default)s)")
    parser.add_argument("--cores", type=_positive, default=2, metavar="N", help="cores of a node (default %(default)s)")
    parser.add_argument(
        "--memory",
        type=float,
        default=float("inf"),
        metavar="MB",
        help="memory of a node (default: enough for its cores)",
    )
    parser.add_argument("--remaining", action="store_true", help="leave out what is made already")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_intermixed_args(arguments)
    study = compose_study(*options.overrides).study
    jobs = study_jobs(
        hydra_line(options.overrides),
        str(project_root() / "Snakefile"),
        ["reproduce", "table"],
        options.cores,
        from_scratch=not options.remaining,
    )
    footage = {
        subject: subject_footage(
            compose(*options.overrides, f"subject={subject}").capture,
            Path("results") / study.name / subject / "capture.json",
        )
        for subject in study.subjects
    }
    earlier = earlier_times(jobs, Path(".snakemake/metadata"))
    speed = speed_test() / REFERENCE_SPEED
    seconds = all_seconds(jobs, footage, options.overrides, earlier, speed)
    schedule = list_schedule(jobs, seconds, options.nodes, options.cores, options.memory)
    sizes = {job.number: job_bytes(job, footage, options.overrides) for job in jobs}
    if options.json:
        print(json.dumps(_summary(jobs, seconds, sizes, schedule, options, earlier, speed), indent=1))
    else:
        print("\n".join(_lines(jobs, seconds, sizes, schedule, options, earlier, speed, footage)))
    return 0


def _summary(
    jobs: Sequence[Job],
    seconds: Mapping[int, float],
    sizes: Mapping[int, float],
    schedule: Schedule,
    options: argparse.Namespace,
    earlier: Mapping[int, float],
    speed: float,
) -> dict[str, object]:
    """The plan as JSON: seconds, bytes and MB."""
    rules = {}
    for rule in dict.fromkeys(job.rule for job in jobs):
        members = [job for job in jobs if job.rule == rule]
        rules[rule] = {
            "jobs": len(members),
            "seconds": sum(seconds[job.number] for job in members),
            "threads": max(job.threads for job in members),
            "memory_mb": max(job.memory for job in members),
            "bytes": sum(sizes[job.number] for job in members),
            "measured": sum(job.number in earlier for job in members),
        }
    chain = critical_path(jobs, seconds)
    return {
        "nodes": options.nodes,
        "cores": options.cores,
        "jobs": len(jobs),
        "core_seconds": sum(seconds[job.number] * job.threads for job in jobs if not job.is_local),
        "makespan_seconds": schedule.makespan,
        "peak_memory_mb": schedule.peak_memory,
        "bytes": sum(sizes.values()),
        "critical_path_seconds": sum(seconds[job.number] for job in chain),
        "critical_path": [
            {"rule": job.rule, "wildcards": job.wildcards, "seconds": seconds[job.number]} for job in chain
        ],
        "speed": speed,
        "rules": rules,
    }


def _lines(
    jobs: Sequence[Job],
    seconds: Mapping[int, float],
    sizes: Mapping[int, float],
    schedule: Schedule,
    options: argparse.Namespace,
    earlier: Mapping[int, float],
    speed: float,
    footage: Mapping[str, Footage],
) -> list[str]:
    """The plan as text."""
    plan = _summary(jobs, seconds, sizes, schedule, options, earlier, speed)
    if not jobs:
        return ["nothing to do"]
    lines = [f"{'rule':12}{'jobs':>6}{'one job':>12}{'all':>12}{'threads':>9}{'MB':>8}{'disk MB':>9}  measured"]
    for rule, row in plan["rules"].items():
        one, total = _duration(row["seconds"] / row["jobs"]), _duration(row["seconds"])
        sized = f"{row['threads']:9}{row['memory_mb']:8.0f}{row['bytes'] / 1e6:9.0f}"
        lines.append(f"{rule:12}{row['jobs']:6}{one:>12}{total:>12}{sized}  {row['measured']} of {row['jobs']}")
    nodes = f"{options.nodes} node{'s' * (options.nodes > 1)} with {options.cores} cores"
    chain = Counter(step["rule"] for step in plan["critical_path"] if step["seconds"] >= 0.1)
    path = ", ".join(f"{count} x {rule}" if count > 1 else rule for rule, count in chain.items())
    lines += [
        "",
        f"{len(jobs)} jobs, {plan['core_seconds'] / 3600:.2f} core hours, {plan['bytes'] / 1e9:.2f} GB on disk",
        f"on {nodes}: {_duration(schedule.makespan)}, at most {schedule.peak_memory / 1000:.1f} GB requested on a node",
        f"critical path, the least on any number of nodes: {_duration(plan['critical_path_seconds'])} ({path})",
        "",
    ]
    for subject in dict.fromkeys(footage.values()):
        names = [name for name, images in footage.items() if images == subject]
        shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        size = f"{subject.megapixels:.3g} megapixels"
        lines.append(f"{shown}: {subject.train} training images, {subject.evaluated} others, {size} ({subject.source})")
    assumed = any("assumed" in images.source for images in footage.values())
    worker_jobs = [job for job in jobs if not job.is_local]
    if all(job.number in earlier for job in worker_jobs):
        doubt = "all jobs ran here before: expect 25 %"
    elif assumed:
        doubt = "the data are not here: within a factor of 3"
    else:
        doubt = f"times from the table of costs x {speed:.2f} for this machine: within a factor of 2"
    return [*lines, f"uncertainty: {doubt}; waits in a queue and embedding networks are not included"]


def _duration(seconds: float) -> str:
    """Seconds in a readable unit."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _positive(text: str) -> int:
    """Parse a number of at least 1."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: expected 1 or more")
    return int(text)
