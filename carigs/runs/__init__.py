"""What a run of the workflow needs and the method does not: which results are current, locks, checks, progress.

- `job_record`: what made the outputs of a job, in a JSON file beside its log
- `current_results`: which results of a study are current, by these records
- `study_graph`: Snakemake's graph of jobs, which asks `current_results`
- `locks`: one run of a study, and one process for each job, at a time
- `planned_job`: a job as Snakemake plans it
- `plan`: the settings, code, packages and files that a job is planned with
- `contents`: digests of the contents of files and folders
- `sources`: the modules and packages that a stage runs
- `outside_files`: files and folders that settings name
- `snakemake_process`: what Snakemake needs to start
- `progress`, `summary`: a line per job; the warnings that a run repeats at its end
- `lap_times`: times of the steps of a stage
- `settings_checks`: what a run says of its settings before it plans
"""
