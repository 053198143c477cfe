"""The table and the figure of a sweep, over all its combinations of values.

There is no such rule in a run of one study: a sweep is asked for by `--config sweep=`.
"""

if swept:

    rule sweep:
        input:
            settings="results/{study}/settings/sweep/all.yaml".format(study=swept.combinations[0].study),
            tables=lambda wildcards: [
                f"results/{combination.study}/table/gamma={gamma_text(combination.overrides)}.csv"
                for combination in swept.combinations
            ],
        output:
            table=f"results/{swept.study}/sweep/{swept.name}.csv",
            markdown=f"results/{swept.study}/sweep/{swept.name}.md",
            figure=f"results/{swept.study}/sweep/{swept.name}.png",
            vector=f"results/{swept.study}/sweep/{swept.name}.pdf",
        log:
            f"results/{swept.study}/log/sweep/{swept.name}.log",
        conda:
            "../../environment.yml"
        params:
            plan=lambda wildcards: job_plan("sweep", swept.combinations[0].overrides),
            swept_keys=list(swept.keys),
            swept_values=[list(combination.values) for combination in swept.combinations],
            seeds=[points(combination.study)["seed"] for combination in swept.combinations],
        script:
            "../scripts/stage.py"
