"""Settings files: the section of the settings that a job reads, written before it starts."""


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
        text=settings_file_text,
    shell:
        "printf %s {params.text:q} > {output:q}.part 2> {log:q} && mv {output:q}.part {output:q}"
