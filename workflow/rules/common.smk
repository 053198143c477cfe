"""The composed studies, and functions that give rules their settings and inputs.

A run has one study; a sweep has one for each combination of values but those of gamma.

Hydra composes values; Snakemake plans files and their order. Every wildcard is a Hydra override (`subject=`, `variant=`,
`seed=`, `gamma=`), so a path names a configuration. Each job leaves a record of what made its outputs
(carigs/runs/job_record.py), and by these records a run finds which results are current (carigs/runs/study_graph.py).
"""

import sys
from contextlib import suppress
from functools import cache
from itertools import product
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger
from snakemake.settings.enums import Quietness

from carigs.cli.run import check_subjects
from carigs.compile_ahead.process import start_compiling
from carigs.config import (
    compose,
    compose_study,
    read_sweep,
    rendered_levels,
    settings_text,
    split_overrides,
    study_table,
    target_levels,
    target_maker,
)
from carigs.errors import CarigsError, print_line
from carigs.system.fork_server import start_fork_server
from carigs.system.run_process import name_run_process
from carigs.runs.progress import show_job_lines
from carigs.runs.summary import warning_lines
from carigs.runs.plan import job_plan
from carigs.runs.settings_checks import check_study, settings_warnings
from carigs.runs.study_graph import use_study_graph
from carigs.settings import STAGES
from carigs.runs.sources import fingerprint


def one_line_errors(function):
    """Report errors of the settings in one line, as Snakemake's `WorkflowError`."""

    def wrapped(*arguments):
        try:
            return function(*arguments)
        except CarigsError as error:
            raise WorkflowError(str(error)) from None

    return wrapped


def overrides_of(study):
    """The Hydra overrides of a study; `gamma=` of a path goes after them."""
    if study not in studies:
        known = ", ".join([*studies][:3])
        raise WorkflowError(f"results/{study}: the study is {known}; choose by --config hydra=study={study}")
    return studies[study][-1]


@cache
@one_line_errors
def points(study):
    """The subjects, variants, seeds and levels of a study; `first_seed` is what figures show.

    With several gammas the card and the report of a study are of the last.
    """
    composed = compose_study(*overrides_of(study))
    seeds = [f"{seed}" for seed in composed.study.seeds]
    return dict(
        study=study,
        subject=list(composed.study.subjects),
        variant=list(composed.study.variants),
        seed=seeds,
        first_seed=seeds[0],
        gamma=gamma_text(overrides_of(study)),
        level=rendered_levels(composed),
    )


@one_line_errors
def gamma_text(overrides):
    """The gamma of composed settings as in paths."""
    return f"{compose(*overrides).gamma:g}"


@one_line_errors
def section(stage, wildcards, *names):
    """The composed settings of a stage; `names` are the wildcards that become overrides."""
    return compose(*overrides_of(wildcards.study), *(f"{name}={wildcards[name]}" for name in names))[stage]


@one_line_errors
def settings_file_text(wildcards):
    """The text of a settings file; the wildcard `point` is the list of overrides that it depends on."""
    point = [override for override in wildcards.point.split(",") if override != "all"]
    return settings_text(wildcards.stage, *overrides_of(wildcards.study), *point)


@one_line_errors
def levels(wildcards):
    """The levels at which avatars trained for the gamma of a path are rendered."""
    return rendered_levels(compose(*overrides_of(wildcards.study), f"gamma={wildcards.gamma}"))


def level(wildcards):
    """The level in a path as a number."""
    if float(wildcards.level) > float(wildcards.gamma):
        raise WorkflowError(f"level={wildcards.level} is outside [0, {wildcards.gamma}], the range trained for")
    return float(wildcards.level)


def all_points(*patterns):
    """The files of every subject, variant, seed and level of the study, but for the wildcards that the output fixes."""
    return lambda wildcards: collect(
        list(patterns), **{**points(wildcards.study), **dict(wildcards.items()), "level": levels(wildcards)}
    )


def of_study(*patterns):
    """The files of every subject, variant, seed and level of the study at its gamma."""
    return lambda wildcards: collect(list(patterns), **points(wildcards.study))


def at_gamma(*patterns):
    """The files of a subject at the gamma of its study."""
    return lambda wildcards: collect(list(patterns), **dict(wildcards.items()), gamma=points(wildcards.study)["gamma"])


def table_of_study(wildcards):
    """The table of the study's gamma."""
    return "results/{study}/table/gamma={gamma}.csv".format(**points(wildcards.study))


def of_all_studies(*patterns):
    """The files of every study at each of its gammas."""

    def files(wildcards):
        gammas = {study: list(map(gamma_text, studies[study])) for study in studies}
        return [
            file for study in studies for file in collect(list(patterns), **points(study) | {"gamma": gammas[study]})
        ]

    return files


def tracked_video(wildcards):
    """The dataset of a subject's video, if it has one."""
    is_video = section("capture", wildcards, "subject").source == "video"
    return f"results/{wildcards.study}/{wildcards.subject}/tracked" if is_video else []


def avatar_of_method(wildcards):
    """The avatar of the variant `alternating` with the first seed, if the study has the variant."""
    known = points(wildcards.study)
    folder = f"results/{wildcards.study}/{wildcards.subject}/gamma={wildcards.gamma}/alternating"
    return f"{folder}/seed={known['first_seed']}/avatar.npz" if "alternating" in known["variant"] else []


def pages_of_method(wildcards):
    """The HTML file of each subject's avatar of the variant `alternating` with the first seed, if the study has it."""
    known = points(wildcards.study)
    pattern = "results/{study}/{subject}/gamma={gamma}/alternating/seed={first_seed}/avatar.html"
    return collect(pattern, **known) if "alternating" in known["variant"] else []


def plan(stage, *names):
    """What a job of a stage is planned with; `names` are the wildcards that become overrides."""

    @one_line_errors
    def planned(wildcards):
        overrides = (*overrides_of(wildcards.study), *(f"{name}={wildcards[name]}" for name in names))
        return job_plan(stage, overrides, level(wildcards) if "level" in wildcards.keys() else None)

    return planned


@one_line_errors
def target_files(pattern, point):
    """The file of each level whose GT* frames a variant is trained on; `point` has the wildcards of the training.

    Variants with the same section `gtstar` share GT* frames; `{maker}` in the pattern is the variant that they are stored
    under.
    """
    overrides = (*overrides_of(point["study"]), f"subject={point['subject']}")
    maker = target_maker(point["variant"], *overrides)
    trained_levels = target_levels(compose(*overrides, f"variant={point['variant']}").train, float(point["gamma"]))
    return collect(pattern, **{**point, "maker": maker, "level": trained_levels})


def targets(pattern):
    """The files of the GT* frames that a training needs."""
    return lambda wildcards: target_files(pattern, dict(wildcards.items()))


def target_sheets(wildcards):
    """The contact sheets of all GT* frames of all studies."""
    pattern = "results/{study}/{subject}/gamma={gamma}/targets/{maker}/level={level}/inspection.png"
    sheets = []
    for study in studies:
        known = points(study)
        for subject, variant, gamma in product(known["subject"], known["variant"], map(gamma_text, studies[study])):
            sheets += target_files(pattern, dict(study=study, subject=subject, variant=variant, gamma=gamma))
    return list(dict.fromkeys(sheets))


def all_settings_warnings():
    """The warnings of the settings of all studies, each once."""
    combinations = [overrides for gammas in studies.values() for overrides in gammas]
    return list(dict.fromkeys(line for overrides in combinations for line in settings_warnings(overrides)))


name_run_process()
if unknown := sorted(set(config) - {"hydra", "sweep"}):
    raise WorkflowError(f"--config {unknown[0]}= is unknown; overrides go into hydra='study=ict gamma=0.2'")

overrides, values = (one_line_errors(split_overrides)(str(config.get(key) or ""), key) for key in ("hydra", "sweep"))
swept = one_line_errors(read_sweep)(overrides, values) if values else None
studies = one_line_errors(study_table)(overrides, swept)

if workflow.is_main_process:
    for study in studies:
        # Checked here, because Snakemake ignores errors of input functions where the output exists.
        one_line_errors(check_study)(studies[study])
        one_line_errors(check_subjects)(overrides_of(study))
    use_study_graph()
    for line in one_line_errors(all_settings_warnings)():
        print_line(f"warning: {line}")


def print_warnings():
    """Repeat the warnings of the settings and of the studies' jobs, those of earlier runs too."""
    logged = warning_lines(Path("results", study, "log") for study in studies)
    for line in [*all_settings_warnings(), *logged]:
        print_line(f"warning: {line}")


def print_results():
    """Say where tables, figures, card, report and avatars are; of a sweep, where its table and figure are."""
    study = swept.study if swept else next(iter(studies))
    if swept:
        names = [f"sweep/{swept.name}{suffix}" for suffix in (".md", ".csv", ".png", ".pdf")]
    else:
        names = [f"table/gamma={points(study)['gamma']}.md", "figures", "card.md", "report.html"]
        pattern = "{subject}/gamma={gamma}/alternating/seed={first_seed}/avatar.html"
        names += collect(pattern, **points(study))
    for path in (Path("results", study, name) for name in names):
        if path.exists():
            print_line(str(path))


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
        by_study = {study: overrides_of(study) for study in studies}
        line = announcement(plan_study(needed_jobs(workflow), by_study, nodes=1, cores=workflow.cores))
        if line:
            print_line(line)


def compile_ahead(workflow):
    """Compile kernels of the first study that trains while the first jobs work, if the cache has none."""
    from carigs.planning.job_graph import needed_jobs

    trained = [job.wildcards["study"] for job in needed_jobs(workflow) if job.rule == "train"]
    if trained:
        start_compiling(overrides_of(trained[0]))


wildcard_constraints:
    study=r"[\w.+=,-]+",  # with the values of a combination of a sweep
    stage="|".join(STAGES),
    subject=r"[\w-]+",
    variant=r"[\w-]+",
    # Numbers have one form: 0.25, not 0.250.
    seed=r"0|[1-9]\d*",
    gamma=r"(0|[1-9]\d*)(\.\d*[1-9])?",
    level=r"(0|[1-9]\d*)(\.\d*[1-9])?",
