"""Stress tests: input that breaks numerics, broken files, and invariants on real heads. A wrong case fails `stress`."""

TESTS = Path(workflow.basedir, "tests")
SUITES = ("raster", "targets", "rig", "rasterizer", "metrics")


localrules:
    stress,


rule stress:
    input:
        "results/stress/summary.csv",
        ["results/stress/captures.csv"] if heads else [],


rule stress_summary:
    input:
        suites=collect(
            "results/stress/{suite}.csv", suite=["surface", *SUITES, "hostile_files", *(["heads"] if heads else [])]
        ),
    output:
        rows="results/stress/summary.csv",
    log:
        "results/stress/log/summary.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=500,
    params:
        code=lambda wildcards: fingerprint("stress.summary"),
    shell:
        "PYTHONPATH={TESTS:q} python -m stress.summary {output.rows:q} {input.suites:q} 2>&1 | tee {log:q}"


rule stress_suite:
    output:
        rows="results/stress/{suite}.csv",
    log:
        "results/stress/log/{suite}.log",
    wildcard_constraints:
        suite="|".join(SUITES),
    conda:
        "../../environment.yml"
    resources:
        mem_mb=2000,
    params:
        code=lambda wildcards: fingerprint(f"stress.{wildcards.suite}"),
    shell:
        "PYTHONPATH={TESTS:q} python -m stress.{wildcards.suite} {output.rows:q} --keep-going > {log:q} 2>&1"


rule stress_surface:
    input:
        # A bumpy sphere where CARIGS_DATA does not name the folder with real heads.
        mesh=[head for head in heads if head.endswith("ict_head_id0_5042.obj")],
    output:
        rows="results/stress/surface.csv",
    log:
        "results/stress/log/surface.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=2000,
    params:
        code=lambda wildcards: fingerprint("stress.surface"),
    shell:
        "PYTHONPATH={TESTS:q} python -m stress.surface {output.rows:q} {input.mesh:q} --keep-going > {log:q} 2>&1"


rule stress_heads:
    input:
        meshes=heads,
        model=[f"{environ['CARIGS_DATA']}/ict_model.npz"] if heads else [],
    output:
        rows="results/stress/heads.csv",
    log:
        "results/stress/log/heads.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=2000,
    params:
        code=lambda wildcards: fingerprint("stress.heads"),
    shell:
        "PYTHONPATH={TESTS:q} python -m stress.heads {output.rows:q} {input.meshes:q} --head-model {input.model:q} --keep-going"
        " > {log:q} 2>&1"


rule stress_hostile_files:
    output:
        rows="results/stress/hostile_files.csv",
    log:
        "results/stress/log/hostile_files.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=3000,
    params:
        code=lambda wildcards: fingerprint("stress.hostile_files"),
    shell:
        "PYTHONPATH={TESTS:q} python -m stress.hostile_files {output.rows:q} > {log:q} 2>&1"


rule stress_captures:
    input:
        capture=[f"{environ['CARIGS_DATA']}/ict_s1"] if heads else [],
        model=[f"{environ['CARIGS_DATA']}/ict_model.npz"] if heads else [],
    output:
        rows="results/stress/captures.csv",
    log:
        "results/stress/log/captures.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=2000,
    params:
        code=lambda wildcards: fingerprint("stress.captures"),
    shell:
        "PYTHONPATH={TESTS:q} python -m stress.captures {output.rows:q} {input.capture:q} {input.model:q} > {log:q} 2>&1"
