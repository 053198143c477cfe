"""The composed study, and functions that give rules their settings and inputs.

Hydra composes values; Snakemake plans files and their order. Every wildcard is a Hydra override (`subject=`, `variant=`,
`seed=`, `gamma=`), so a path names a configuration. Each job leaves a record of the settings, code and inputs that made its outputs
(carigs/job_record.py), so that results can be copied without `.snakemake/`.
"""

import sys
from contextlib import suppress
from functools import cache
from itertools import product
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger
from snakemake.settings.enums import Quietness

from carigs.config import (
    compose,
    compose_study,
    compose_variant,
    rendered_levels,
    settings_text,
    split_overrides,
    target_levels,
    target_maker,
)
from carigs.errors import CarigsError
from carigs.fork_server import start_fork_server
from carigs.job_record import is_stale
from carigs.outside_files import files_digest, outside_files
from carigs.run_process import name_run_process
from carigs.run_progress import show_job_lines
from carigs.run_summary import warning_lines
from carigs.settings import STAGES
from carigs.sources import fingerprint
from carigs.study_start import prepare_results, settings_warnings


def one_line_errors(function):
    """Report errors of the settings in one line, as Snakemake's `WorkflowError`."""

    def wrapped(*arguments):
        try:
            return function(*arguments)
        except CarigsError as error:
            raise WorkflowError(str(error)) from None

    return wrapped


@one_line_errors
def section(stage, wildcards, *names):
    """The composed settings of a stage; `names` are the wildcards that become overrides."""
    return compose(*overrides, *(f"{name}={wildcards[name]}" for name in names))[stage]


@one_line_errors
def settings_file_text(wildcards):
    """The text of a settings file; the wildcard `point` is the list of overrides that it depends on."""
    if wildcards.study != points["study"]:
        raise WorkflowError(
            f"results/{wildcards.study}: the study is {points['study']}; choose by --config hydra=study={wildcards.study}"
        )
    point = [override for override in wildcards.point.split(",") if override != "all"]
    return settings_text(wildcards.stage, *overrides, *point)


def settings_trigger(wildcards):
    """The current folder: newer than a settings file that is to be written again, and without effect on others."""
    file = Path(f"results/{wildcards.study}/settings/{wildcards.stage}/{wildcards.point}.yaml")
    return local(".") if is_stale(file) else ancient(local("."))


@one_line_errors
def levels(wildcards):
    """The levels at which avatars trained for the gamma of a path are rendered."""
    return rendered_levels(compose(*overrides, f"gamma={wildcards.gamma}"))


def level(wildcards):
    """The level in a path as a number."""
    if float(wildcards.level) > float(wildcards.gamma):
        raise WorkflowError(f"level={wildcards.level} is outside [0, {wildcards.gamma}], the range trained for")
    return float(wildcards.level)


def all_points(*patterns, **fixed):
    """The files of every subject, variant, seed and level of the study, but for `fixed` and the output's wildcards."""
    return lambda wildcards: collect(
        list(patterns), **{**points, **fixed, **dict(wildcards.items()), "level": levels(wildcards)}
    )


def of_study(*patterns, **fixed):
    """The files of every subject, variant, seed and level of the study at its gamma, but for `fixed` wildcards."""
    return lambda wildcards: collect(list(patterns), **{**points, **fixed, "study": wildcards.study})


def rendered_points(wildcards):
    """Variant and level of each rendering of a subject and seed, in the order of `all_points`."""
    return list(product(points["variant"], levels(wildcards)))


digest = cache(files_digest)


def outside(stage, *names):
    """Digests of the files that the settings of a stage name, such as a dataset: a job runs again when they change."""

    def digests(wildcards):
        at = level(wildcards) if "level" in wildcards.keys() else None
        return {
            str(path): digest(path) for path in outside_files(stage, section(stage, wildcards, *names), at).values()
        }

    return digests


def targets(pattern):
    """The file of each level whose GT* frames a variant is trained on.

    Variants with the same section `gtstar` share GT* frames; `{maker}` in the pattern is the variant that they are stored
    under.
    """

    @one_line_errors
    def target_files(wildcards):
        maker = target_maker(wildcards.variant, *overrides, f"subject={wildcards.subject}")
        trained_levels = target_levels(section("train", wildcards, "subject", "variant"), float(wildcards.gamma))
        return collect(pattern, **{**dict(wildcards.items()), "maker": maker, "level": trained_levels})

    return target_files


name_run_process()
if unknown := sorted(set(config) - {"hydra"}):
    raise WorkflowError(f"--config {unknown[0]}= is unknown; overrides go into hydra='study=ict gamma=0.2'")

overrides = one_line_errors(split_overrides)(str(config.get("hydra") or ""))
composed = one_line_errors(compose_study)(*overrides)
points = dict(
    study=composed.study.name,
    subject=list(composed.study.subjects),
    variant=list(composed.study.variants),
    seed=[f"{seed}" for seed in composed.study.seeds],
    gamma=f"{composed.gamma:g}",
    level=rendered_levels(composed),
)
first_seed = points["seed"][0]  # of what figures show
for subject, variant in product(points["subject"], points["variant"]):
    # Checked here, because Snakemake ignores errors of input functions where the output exists.
    one_line_errors(compose_variant)(variant, *overrides, f"subject={subject}")

if workflow.is_main_process:
    one_line_errors(prepare_results)(Path("results", points["study"]), overrides)
    for line in one_line_errors(settings_warnings)(overrides):
        print(f"carigs: warning: {line}", file=sys.stderr)


def print_warnings():
    """Repeat the warnings of the settings and of the study's jobs, those of earlier runs too."""
    for line in [*settings_warnings(overrides), *warning_lines(Path("results", points["study"], "log"))]:
        print(f"carigs: warning: {line}", file=sys.stderr)


def print_results():
    """Say where tables, figures, card and report are."""
    folder = Path("results", points["study"])
    for path in (
        folder / f"table/gamma={points['gamma']}.md",
        folder / "figures",
        folder / "card.md",
        folder / "report.html",
    ):
        if path.exists():
            print(f"carigs: {path}", file=sys.stderr)


def show_progress(workflow):
    """Print a line per job instead of Snakemake's ten, unless an option of its output is given."""
    output = workflow.output_settings
    if not (output.verbose or output.printshellcmds or set(output.quiet) - {Quietness.HOST}):
        show_job_lines(logger, len(workflow.dag), workflow._localrules)


def announce_duration(workflow):
    """Say how long the jobs will take on this machine, if it is minutes."""
    from carigs.planning.job_graph import needed_jobs
    from carigs.planning.study_plan import announcement, plan_study

    with suppress(CarigsError):  # what cannot be read ends the job that reads it
        line = announcement(plan_study(needed_jobs(workflow), overrides, nodes=1, cores=workflow.cores))
        if line:
            print(f"carigs: {line}", file=sys.stderr)


wildcard_constraints:
    study=r"[\w.-]+",
    stage="|".join(STAGES),
    subject=r"[\w-]+",
    variant=r"[\w-]+",
    # Numbers have one form: 0.25, not 0.250.
    seed=r"0|[1-9]\d*",
    gamma=r"(0|[1-9]\d*)(\.\d*[1-9])?",
    level=r"(0|[1-9]\d*)(\.\d*[1-9])?",
