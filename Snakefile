"""The workflow of a study: from captures to caricature avatars, their table, figures and report.

carigs run study=ict train.iterations=2000 --cores 2                                     in any folder
snakemake --cores 2 reproduce table                                                      the toy study, in the repository
snakemake --cores 2 --config hydra="study=ict train.iterations=2000" -- reproduce table  Hydra overrides, split on blanks
snakemake --cores 2 --config hydra="study=ict" sweep="gamma=0.1,0.2" -- sweep            overrides with several values
"""


include: "workflow/rules/common.smk"
include: "workflow/rules/settings.smk"
include: "workflow/rules/avatar.smk"
include: "workflow/rules/evaluate.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/sweep.smk"


# What an installed carigs lacks.
if Path(workflow.basedir, "tests").is_dir():

    include: "workflow/rules/benchmark.smk"
    include: "workflow/rules/stress.smk"


onstart:
    show_progress(workflow)
    if workflow.local_exec:
        # With a limit of jobs per second, Snakemake starts a timer of one second whenever it selects jobs, and selects
        # jobs again when the timer ends. Each job that ends adds such a chain: after a hundred jobs, Snakemake selects
        # jobs a hundred times a second. On this machine, --cores limits the jobs; --max-jobs-per-timespan has no effect.
        workflow.scheduler.job_rate_limiter = None
        announce_duration(workflow)
        start_fork_server(workflow.cores)
        compile_ahead(workflow)


onsuccess:
    print_warnings()
    print_results()


onerror:
    print_warnings()


localrules:
    reproduce,
    table,


rule reproduce:
    default_target: True
    input:
        of_all_studies(
            "results/{study}/table/gamma={gamma}.csv",
            "results/{study}/figures/{subject}/gamma={gamma}",
            "results/{study}/report.html",
        ),
        target_sheets,


rule table:
    input:
        of_all_studies("results/{study}/table/gamma={gamma}.csv"),
