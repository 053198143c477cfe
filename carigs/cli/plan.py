"""`carigs plan`: what a study will cost, before it starts."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from carigs.cli.options.parser import study_parser
from carigs.config import project_root, read_sweep, snakemake_config, split_sweep, study_table
from carigs.planning.footage import Footage
from carigs.planning.job_graph import study_jobs
from carigs.planning.schedule import critical_path
from carigs.planning.study_plan import StudyPlan, duration, plan_study, uncertainty
from carigs.planning.study_subjects import check_subjects
from carigs.system.extras import need

DESCRIPTION = """Print the jobs of a study, their hours, memory and disk, and the time on a number of nodes.

Times come from an earlier run in this directory where there was one, else from a table of costs that was measured on
another machine and is scaled by a short test of this one. The schedule is simulated.
"""
EXAMPLES = """examples:
  carigs plan                                   the toy study on one node with two cores
  carigs plan study=paper --nodes 8 --cores 16
  carigs plan study=ict --remaining             only what has not been made yet
  carigs plan study=paper --json
  carigs plan gamma=0.1,0.2                     a sweep
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    usage = "[--nodes N] [--cores N] [--memory MB] [--remaining] [--json]"
    parser = study_parser("plan", DESCRIPTION, EXAMPLES, usage)
    parser.add_argument("--nodes", type=_positive, default=1, metavar="N", help="nodes (default %(default)s)")
    parser.add_argument("--cores", type=_positive, default=2, metavar="N", help="cores of a node (default %(default)s)")
    memory_help = "memory of a node (default: enough for its cores)"
    parser.add_argument("--memory", type=float, default=float("inf"), metavar="MB", help=memory_help)
    parser.add_argument("--remaining", action="store_true", help="leave out what is made already")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_intermixed_args(arguments)
    need("snakemake")
    overrides, swept = split_sweep(options.overrides)
    studies = study_table(overrides, read_sweep(overrides, swept) if swept else None)
    for combinations in studies.values():
        check_subjects(combinations[0])
    config, snakefile = snakemake_config(overrides, swept), str(project_root() / "Snakefile")
    targets = ["sweep"] if swept else ["reproduce", "table"]
    jobs = study_jobs(config, snakefile, targets, options.cores, from_scratch=not options.remaining)
    by_study = {study: combinations[-1] for study, combinations in studies.items()}
    plan = plan_study(jobs, by_study, options.nodes, options.cores, options.memory)
    print(json.dumps(_summary(plan), indent=1) if options.json else _text(plan))
    return 0


def _summary(plan: StudyPlan) -> dict[str, object]:
    """The plan as JSON: seconds, bytes and MB."""
    seconds = plan.seconds
    rules = {}
    for rule in dict.fromkeys(job.rule for job in plan.jobs):
        members = [job for job in plan.jobs if job.rule == rule]
        rules[rule] = {
            "jobs": len(members),
            "seconds": sum(seconds[job.number] for job in members),
            "threads": max(job.threads for job in members),
            "memory_mb": max(job.memory for job in members),
            "bytes": sum(plan.sizes[job.number] for job in members),
            "measured": sum(job.number in plan.earlier for job in members),
        }
    chain = critical_path(plan.jobs, seconds)
    return {
        "nodes": plan.nodes,
        "cores": plan.cores,
        "jobs": len(plan.jobs),
        "core_seconds": sum(seconds[job.number] * job.threads for job in plan.jobs if not job.is_local),
        "makespan_seconds": plan.schedule.makespan,
        "peak_memory_mb": plan.schedule.peak_memory,
        "bytes": sum(plan.sizes.values()),
        "critical_path_seconds": sum(seconds[job.number] for job in chain),
        "critical_path": [
            {"rule": job.rule, "wildcards": job.wildcards, "seconds": seconds[job.number]} for job in chain
        ],
        "speed": plan.speed,
        "rules": rules,
    }


def _text(plan: StudyPlan) -> str:
    """The plan as text."""
    if not plan.jobs:
        return "nothing to do"
    summary = _summary(plan)
    lines = [f"{'rule':12}{'jobs':>6}{'one job':>12}{'all':>12}{'threads':>9}{'MB':>8}{'disk MB':>9}  measured"]
    for rule, row in summary["rules"].items():
        one, total = duration(row["seconds"] / row["jobs"]), duration(row["seconds"])
        sized = f"{row['threads']:9}{row['memory_mb']:8.0f}{row['bytes'] / 1e6:9.0f}"
        lines.append(f"{rule:12}{row['jobs']:6}{one:>12}{total:>12}{sized}  {row['measured']} of {row['jobs']}")
    nodes = f"{plan.nodes} node{'s' * (plan.nodes > 1)} with {plan.cores} cores"
    makespan, memory = duration(plan.schedule.makespan), f"{plan.schedule.peak_memory / 1000:.1f} GB"
    core_hours, disk = f"{summary['core_seconds'] / 3600:.2f} core hours", f"{summary['bytes'] / 1e9:.2f} GB on disk"
    chain = Counter(step["rule"] for step in summary["critical_path"] if step["seconds"] >= 0.1)
    path = ", ".join(f"{count} x {rule}" if count > 1 else rule for rule, count in chain.items())
    lines += [
        "",
        f"{len(plan.jobs)} jobs, {core_hours}, {disk}",
        f"on {nodes}: {makespan}, at most {memory} requested on a node",
        f"critical path, the least on any number of nodes: {duration(summary['critical_path_seconds'])} ({path})",
        "",
        *_footage_lines(plan.footage),
        f"uncertainty: {uncertainty(plan)}; waits in a queue and embedding networks are not included",
    ]
    return "\n".join(lines)


def _footage_lines(footage: Mapping[tuple[str, str], Footage]) -> list[str]:
    """The images of the subjects, one line for subjects with the same."""
    lines, different = [], {}
    for (_, subject), images in footage.items():  # the combinations of a sweep mostly have the same
        different.setdefault((subject, replace(images, source="")), images)
    for images in dict.fromkeys(different.values()):
        names = [subject for (subject, _), other in different.items() if other == images]
        shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        size = f"{images.megapixels:.3g} megapixels"
        lines.append(
            f"{shown}: {images.train} training images, {images.val + images.test} others, {size} ({images.source})"
        )
    return lines


def _positive(text: str) -> int:
    """Parse a number of at least 1."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: expected 1 or more")
    return int(text)
