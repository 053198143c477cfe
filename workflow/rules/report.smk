"""The benchmark card of a study, and its report: one page with everything that was measured."""

made_with = of_study(
    "results/{study}/settings/capture/subject={subject}.yaml",
    "results/{study}/settings/exaggerate/subject={subject},gamma={gamma}.yaml",
    "results/{study}/settings/train/subject={subject},variant={variant},seed={seed}.yaml",
    "results/{study}/settings/render/subject={subject}.yaml",
    "results/{study}/settings/truth/subject={subject}.yaml",
    "results/{study}/settings/metrics/subject={subject}.yaml",
    "results/{study}/settings/tabulate/all.yaml",
    "results/{study}/settings/figures/subject={subject}.yaml",
)


rule card:
    input:
        settings="results/{study}/settings/card/all.yaml",
        table=f"results/{{study}}/table/gamma={points['gamma']}.csv",
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
        code=fingerprint("carigs.stages.card"),
        subjects=points["subject"],
        variants=points["variant"],
        seeds=points["seed"],
        levels=points["level"],
        gamma=points["gamma"],
        logs="results/{study}/log",
    script:
        "../scripts/stage.py"


rule report:
    input:
        settings="results/{study}/settings/report/all.yaml",
        card="results/{study}/card.json",
        table=f"results/{{study}}/table/gamma={points['gamma']}.csv",
        figures=of_study("results/{study}/figures/{subject}/gamma={gamma}"),
        captures=of_study("results/{study}/{subject}/capture.json"),
        indices=of_study(
            "results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/level={level}/frames.json", seed=first_seed
        ),
        truths=of_study("results/{study}/{subject}/gamma={gamma}/truth/level={level}/truth.json"),
        training=of_study("results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/log.csv", seed=first_seed),
        made_with=made_with,
        watch=of_study(
            "results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/level={level}/frames",
            "results/{study}/{subject}/gamma={gamma}/truth/level={level}/frames",
            seed=first_seed,
        ),
    output:
        page="results/{study}/report.html",
    log:
        "results/{study}/log/report/all.log",
    conda:
        "../../environment.yml"
    params:
        code=fingerprint("carigs.stages.report"),
        subjects=points["subject"],
        variants=points["variant"],
        levels=points["level"],
        logs="results/{study}/log",
    script:
        "../scripts/stage.py"
