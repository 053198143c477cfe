"""Broken input: what comes out is right, or an error that names the element.  A case that does not hold fails the rule."""


localrules:
    stress,


rule stress:
    input:
        "results/stress/surface.csv",


rule stress_surface:
    input:
        # A bumpy ball where the folder with real heads is not known.
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
