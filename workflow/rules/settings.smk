"""What a job may read is frozen before it starts: one section of the settings, at one point."""


localrules:
    settings,


rule settings:
    output:
        "results/{study}/settings/{stage}/{point}.yaml",
    log:
        "results/{study}/log/settings/{stage}/{point}.log",
    conda:
        "../../environment.yml"
    params:
        text=frozen,
    shell:
        "printf %s {params.text:q} > {output:q} 2> {log:q}"
