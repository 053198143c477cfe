"""Stress tests: broken input, and invariants on real heads. A case that fails fails the rule."""


localrules:
    stress,


rule stress:
    input:
        "results/stress/surface.csv",
        "results/stress/hostile_files.csv",
        ["results/stress/heads.csv", "results/stress/captures.csv"] if heads else [],


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
        code=fingerprint("evaluation.stress.surface"),
    shell:
        "python -m evaluation.stress.surface {output.rows:q} {input.mesh:q} > {log:q} 2>&1"


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
        code=fingerprint("evaluation.stress.heads"),
    shell:
        "python -m evaluation.stress.heads {output.rows:q} {input.meshes:q} --head-model {input.model:q} > {log:q} 2>&1"


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
        code=fingerprint("evaluation.stress.hostile_files"),
    shell:
        "python -m evaluation.stress.hostile_files {output.rows:q} > {log:q} 2>&1"


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
        code=fingerprint("evaluation.stress.captures"),
    shell:
        "python -m evaluation.stress.captures {output.rows:q} {input.capture:q} {input.model:q} > {log:q} 2>&1"
