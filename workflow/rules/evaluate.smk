"""Evaluation: true caricatures, metrics, table and figures."""

from omegaconf import OmegaConf


rule truth:
    input:
        settings="results/{study}/settings/truth/subject={subject}.yaml",
        capture="results/{study}/{subject}/capture.json",
        watch="results/{study}/{subject}/dataset",
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
    output:
        frames=directory("results/{study}/{subject}/gamma={gamma}/truth/level={level}/frames"),
        index="results/{study}/{subject}/gamma={gamma}/truth/level={level}/truth.json",
    log:
        "results/{study}/log/truth/{subject},gamma={gamma},level={level}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 4000 * attempt,
    params:
        plan=plan("truth", "subject"),
        level=level,
    script:
        "../scripts/stage.py"


rule metrics:
    input:
        settings="results/{study}/settings/metrics/subject={subject}.yaml",
        frames="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/frames",
        capture="results/{study}/{subject}/capture.json",
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
        truths=all_points("results/{study}/{subject}/gamma={gamma}/truth/level={level}/truth.json"),
        watch=all_points(
            "results/{study}/{subject}/dataset",
            "results/{study}/{subject}/gamma={gamma}/truth/level={level}/frames",
        ),
    output:
        records="results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/metrics.csv",
    log:
        "results/{study}/log/metrics/{subject},gamma={gamma},{variant},seed={seed}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=lambda wildcards, attempt: 6000 * attempt,
    params:
        plan=plan("metrics", "subject"),
        study="{study}",
        subject="{subject}",
        variant="{variant}",
        seed=lambda wildcards: int(wildcards.seed),
        gamma=lambda wildcards: float(wildcards.gamma),
        levels=lambda wildcards: [float(level) for level in levels(wildcards)],
        embeddings="results/{study}/embeddings",
    script:
        "../scripts/stage.py"


rule tabulate:
    input:
        settings="results/{study}/settings/tabulate/all.yaml",
        records=all_points("results/{study}/{subject}/gamma={gamma}/{variant}/seed={seed}/metrics.csv"),
    output:
        table="results/{study}/table/gamma={gamma}.csv",
        markdown="results/{study}/table/gamma={gamma}.md",
        latex="results/{study}/table/gamma={gamma}.tex",
    log:
        "results/{study}/log/tabulate/gamma={gamma}.log",
    conda:
        "../../environment.yml"
    params:
        plan=plan("tabulate"),
    script:
        "../scripts/stage.py"


rule figures:
    input:
        settings="results/{study}/settings/figures/subject={subject}.yaml",
        capture="results/{study}/{subject}/capture.json",
        path="results/{study}/{subject}/gamma={gamma}/path.npz",
        hair="results/{study}/{subject}/hair.npz",
        # Renders the local edits; studies without the method have none.
        avatar=avatar_of_method,
        frames=all_points("results/{study}/{subject}/gamma={gamma}/{variant}/seed={first_seed}/frames"),
        truths=all_points("results/{study}/{subject}/gamma={gamma}/truth/level={level}/truth.json"),
        watch=all_points(
            "results/{study}/{subject}/dataset",
            "results/{study}/{subject}/gamma={gamma}/truth/level={level}/frames",
        ),
    output:
        folder=directory("results/{study}/figures/{subject}/gamma={gamma}"),
    log:
        "results/{study}/log/figures/{subject},gamma={gamma}.log",
    conda:
        "../../environment.yml"
    params:
        plan=plan("figures", "subject"),
        gtstar=lambda wildcards: OmegaConf.to_container(section("gtstar", wildcards, "subject"), resolve=True),
        mask_flags=lambda wildcards: list(section("train", wildcards, "subject").mask_flags),
        variants=lambda wildcards: points(wildcards.study)["variant"],
        levels=lambda wildcards: [float(level) for level in levels(wildcards)],
    script:
        "../scripts/stage.py"
