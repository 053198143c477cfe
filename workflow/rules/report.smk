"""The benchmark card of a study, and its report: one page with everything that was measured."""

made_with = of_study(
    "results/{study}/settings/capture/subject={subject}.yaml",
    "results/{study}/settings/exaggerate/subject={subject},gamma={gamma}.yaml",
    "results/{study}/settings/train/subject={subject},variant={variant},seed={seed}.yaml",
    "results/{study}/settings/render/subject={subject},gamma={gamma}.yaml",
    "results/{study}/settings/truth/subject={subject}.yaml",
    "results/{study}/settings/metrics/subject={subject}.yaml",
    "results/{study}/settings/tabulate/all.yaml",
    "results/{study}/settings/figures/subject={subject}.yaml",
)


rule card:
    input:
        settings="results/{study}/settings/card/all.yaml",
        table=table_of_study,
        captures=of_study("results/{study}/{subject}/capture.json"),
        avatars=of_study("results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/avatar.npz"),
        made_with=made_with,
    output:
        card="results/{study}/card.json",
        markdown="results/{study}/card.md",
    log:
        "results/{study}/log/card/all.log",
    conda:
        "../../environment.yml"
    params:
        plan=plan("card"),
        subjects=lambda wildcards: points(wildcards.study)["subject"],
        variants=lambda wildcards: points(wildcards.study)["variant"],
        seeds=lambda wildcards: points(wildcards.study)["seed"],
        levels=lambda wildcards: points(wildcards.study)["level"],
        gamma=lambda wildcards: points(wildcards.study)["gamma"],
        logs="results/{study}/log",
    script:
        "../scripts/stage.py"


rule report:
    input:
        settings="results/{study}/settings/report/all.yaml",
        card="results/{study}/card.json",
        table=table_of_study,
        figures=of_study("results/{study}/figures/{subject}/gamma={gamma}"),
        captures=of_study("results/{study}/{subject}/capture.json"),
        frames=of_study("results/{study}/{subject}/gamma={gamma}/{variant}/seed={first_seed}/frames"),
        truths=of_study("results/{study}/{subject}/gamma={gamma}/truth/level={level}/truth.json"),
        training=of_study("results/{study}/{subject}/gamma={gamma}/{variant}/seed={first_seed}/log.csv"),
        avatars=pages_of_method,
        made_with=made_with,
        watch=of_study("results/{study}/{subject}/gamma={gamma}/truth/level={level}/frames"),
    output:
        page="results/{study}/report.html",
    log:
        "results/{study}/log/report/all.log",
    conda:
        "../../environment.yml"
    params:
        plan=plan("report"),
        subjects=lambda wildcards: points(wildcards.study)["subject"],
        variants=lambda wildcards: points(wildcards.study)["variant"],
        levels=lambda wildcards: points(wildcards.study)["level"],
        logs="results/{study}/log",
    script:
        "../scripts/stage.py"
