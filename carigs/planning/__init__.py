"""What a study will cost: its jobs, the time of each, and a simulated schedule.

- `job_graph`: the jobs of a study and what each waits for, from Snakemake
- `footage`: number and size of a subject's images, as far as they are known
- `costs`: seconds and bytes of a job
- `schedule`: when each job runs on a number of nodes
- `study_plan`: all of this for a study, and what a run says of it when it starts
"""
