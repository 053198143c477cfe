"""Benchmarks of the parts. Each takes all cores, so that no other job disturbs the timing."""

from os import environ
from pathlib import Path

# Benchmarks that need no input and have no plot.
parts = ("capture_index", "image_metric_cost", "metric_cost", "refined_step")
heads = sorted(map(str, Path(environ["CARIGS_DATA"]).glob("meshes/*.obj"))) if "CARIGS_DATA" in environ else []


localrules:
    benchmark,
    benchmark_page,


rule benchmark:
    input:
        "results/benchmark/benchmarks.md",
        expand("results/benchmark/{part}.csv", part=parts),
        lambda _: "results/benchmark/quality/{study}/{subject[0]}.csv".format(**points(next(iter(studies)))),


rule benchmark_page:
    input:
        rows=expand("results/benchmark/{part}.csv", part=("surface", "target", "training", "splat")),
    output:
        page="results/benchmark/benchmarks.md",
        figures=expand(
            "results/benchmark/images/trade_offs_{stage}.{type}",
            stage=("exaggerate", "gtstar", "train"),
            type=("png", "pdf"),
        ),
    log:
        "results/benchmark/log/benchmarks.log",
    conda:
        "../../environment.yml"
    params:
        code=lambda wildcards: fingerprint("evaluation.trade_offs.page"),
    shell:
        "python -m evaluation.trade_offs.page {output.page:q} {input.rows:q} > {log:q} 2>&1"


rule benchmark_quality:
    input:
        settings=[
            "results/{study}/settings/train/subject={subject},variant=alternating,seed=0.yaml",
            "results/{study}/settings/gtstar/subject={subject},variant=alternating.yaml",
            "results/{study}/settings/hair/subject={subject}.yaml",
        ],
        capture="results/{study}/{subject}/capture.json",
        hair="results/{study}/{subject}/hair.npz",
        path=at_gamma("results/{study}/{subject}/gamma={gamma}/path.npz"),
        targets=at_gamma("results/{study}/{subject}/gamma={gamma}/targets/alternating/level={gamma}/targets.json"),
        truths=at_gamma(
            "results/{study}/{subject}/gamma={gamma}/truth/level=0/truth.json",
            "results/{study}/{subject}/gamma={gamma}/truth/level={gamma}/truth.json",
        ),
    output:
        rows="results/benchmark/quality/{study}/{subject}.csv",
        plot="results/benchmark/quality/{study}/{subject}.png",
    log:
        "results/benchmark/log/quality/{study}/{subject}.log",
    conda:
        "../../environment.yml"
    threads: 64  # Snakemake lowers it to --cores
    resources:
        mem_mb=6000,
    params:
        code=lambda wildcards: fingerprint("evaluation.benchmarks.quality"),
        folder=lambda wildcards, input: Path(input.path[0]).parent,
    shell:
        "python -m evaluation.benchmarks.quality {output.rows:q} {params.folder:q} > {log:q} 2>&1"


rule benchmark_part:
    output:
        rows="results/benchmark/{part}.csv",
    log:
        "results/benchmark/log/{part}.log",
    wildcard_constraints:
        part="|".join(parts),
    conda:
        "../../environment.yml"
    threads: 64  # Snakemake lowers it to --cores
    resources:
        mem_mb=4000,
    params:
        code=lambda wildcards: fingerprint(f"evaluation.benchmarks.{wildcards.part}"),
    shell:
        "python -m evaluation.benchmarks.{wildcards.part} {output.rows:q} > {log:q} 2>&1"


rule benchmark_splat:
    output:
        rows="results/benchmark/splat.csv",
        plot="results/benchmark/splat.png",
    log:
        "results/benchmark/log/splat.log",
    conda:
        "../../environment.yml"
    threads: 64  # Snakemake lowers it to --cores
    resources:
        mem_mb=4000,
    params:
        code=lambda wildcards: fingerprint("evaluation.benchmarks.splat"),
    shell:
        "python -m evaluation.benchmarks.splat {output.rows:q} > {log:q} 2>&1"


rule benchmark_surface:
    input:
        # Only spheres and a torus where CARIGS_DATA does not name the folder with real heads.
        meshes=heads,
        model=[f"{environ['CARIGS_DATA']}/ict_model.npz"] if heads else [],
    output:
        rows="results/benchmark/surface.csv",
        plot="results/benchmark/surface.png",
    log:
        "results/benchmark/log/surface.log",
    conda:
        "../../environment.yml"
    threads: 64  # Snakemake lowers it to --cores
    resources:
        mem_mb=4000,
    params:
        code=lambda wildcards: fingerprint("evaluation.benchmarks.surface"),
        model=lambda wildcards, input: ["--head-model", *input.model] if input.model else [],
    shell:
        "python -m evaluation.benchmarks.surface {output.rows:q} {input.meshes:q} {params.model:q} > {log:q} 2>&1"


rule benchmark_target:
    output:
        rows="results/benchmark/target.csv",
        plot="results/benchmark/target.png",
    log:
        "results/benchmark/log/target.log",
    conda:
        "../../environment.yml"
    threads: 64  # Snakemake lowers it to --cores
    resources:
        mem_mb=4000,
    params:
        code=lambda wildcards: fingerprint("evaluation.benchmarks.target"),
    shell:
        "python -m evaluation.benchmarks.target {output.rows:q} > {log:q} 2>&1"


rule benchmark_training:
    output:
        rows="results/benchmark/training.csv",
    log:
        "results/benchmark/log/training.log",
    conda:
        "../../environment.yml"
    threads: 64  # Snakemake lowers it to --cores
    resources:
        mem_mb=4000,
    params:
        code=lambda wildcards: fingerprint("evaluation.benchmarks.training_trade_offs"),
        settings=lambda wildcards: [
            settings_text(stage, "study=toy", "variant=alternating", f"preset={preset}")
            for stage in ("capture", "exaggerate", "gtstar", "train")
            for preset in ("fast", "balanced", "best")
        ],
    shell:
        "python -m evaluation.benchmarks.training_trade_offs {output.rows:q} > {log:q} 2>&1"
