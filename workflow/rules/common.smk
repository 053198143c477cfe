"""The composed study, its points, and how settings and code reach the rules.

Hydra owns values, Snakemake owns files and order.  Every wildcard is a Hydra override (`subject=`, `variant=`, `gamma=`),
so a path names a configuration.  `.snakemake/` belongs to the results: without it an edited key looks up to date.
"""

from itertools import product

from snakemake.exceptions import WorkflowError

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
from carigs.settings import STAGES
from carigs.sources import fingerprint


def readable(function):
    """What is the user's fault is told in one line."""

    def inner(*arguments):
        try:
            return function(*arguments)
        except CarigsError as error:
            raise WorkflowError(str(error)) from None

    return inner


@readable
def section(stage, wildcards, *names):
    """The settings of a stage at the point that these wildcards name."""
    return compose(*overrides, *(f"{name}={wildcards[name]}" for name in names))[stage]


@readable
def frozen(wildcards):
    """The text of a settings file; the file's name is the list of overrides that it may depend on."""
    if wildcards.study != points["study"]:
        raise WorkflowError(
            f"results/{wildcards.study}: the study is {points['study']}; choose by --config hydra=study={wildcards.study}"
        )
    point = [override for override in wildcards.point.split(",") if override != "all"]
    return settings_text(wildcards.stage, *overrides, *point)


@readable
def levels(wildcards):
    """The levels rendered for the gamma of a path."""
    return rendered_levels(compose(*overrides, f"gamma={wildcards.gamma}"))


def level(wildcards):
    """The level of a path as a number."""
    if float(wildcards.level) > float(wildcards.gamma):
        raise WorkflowError(f"level={wildcards.level} is outside [0, {wildcards.gamma}], the range trained for")
    return float(wildcards.level)


def each(*patterns):
    """These files for every point of the study that shares the wildcards of a path."""
    return lambda wildcards: collect(
        list(patterns), **{**points, **dict(wildcards.items()), "level": levels(wildcards)}
    )


def shown(wildcards):
    """The variant and level of each rendering of a subject, in the order of `each`."""
    return list(product(points["variant"], levels(wildcards)))


def targets(pattern):
    """This file for each level whose targets a variant is trained on; `{maker}` is the variant in whose name they are
    made, for all that have the same settings of `gtstar`."""

    @readable
    def inner(wildcards):
        maker = target_maker(wildcards.variant, *overrides, f"subject={wildcards.subject}")
        trained = target_levels(section("train", wildcards, "subject", "variant"), float(wildcards.gamma))
        return collect(pattern, **{**dict(wildcards.items()), "maker": maker, "level": trained})

    return inner


if unknown := sorted(set(config) - {"hydra"}):
    raise WorkflowError(f"--config {unknown[0]}= is unknown; overrides go into hydra='study=ict gamma=0.2'")

overrides = readable(split_overrides)(str(config.get("hydra") or ""))
chosen = readable(compose_study)(*overrides)
points = dict(
    study=chosen.study.name,
    subject=list(chosen.study.subjects),
    variant=list(chosen.study.variants),
    gamma=f"{chosen.gamma:g}",
    level=rendered_levels(chosen),
)
for subject, variant in product(points["subject"], points["variant"]):
    # Now, because Snakemake forgives an input function that fails where the output exists.
    readable(compose_variant)(variant, *overrides, f"subject={subject}")


wildcard_constraints:
    study=r"[\w.-]+",
    stage="|".join(STAGES),
    subject=r"[\w-]+",
    variant=r"(?!truth/)[\w-]+",
    # There is one way to write a number: 0.25, never 0.250.
    gamma=r"(0|[1-9]\d*)(\.\d*[1-9])?",
    level=r"(0|[1-9]\d*)(\.\d*[1-9])?",
