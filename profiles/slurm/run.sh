#!/bin/bash
# sbatch profiles/slurm/run.sh study=mine        Snakemake as a Slurm job of its own, with the options of `carigs run`
#
# Snakemake needs little, but it must outlast all its jobs. Ended by SIGTERM it lets running jobs go on; interrupted
# (SIGINT), as here by `scancel` and at the time limit, it cancels them.
#SBATCH --job-name=carigs
#SBATCH --cpus-per-task=1
#SBATCH --mem=2000
#SBATCH --time=3-00:00:00
#SBATCH --signal=B:TERM@120
set -m # a process group for what follows, and no ignored interrupts in it
carigs run --profile slurm "$@" &
trap 'kill -INT -- -$!' TERM
wait $!
status=$?
while kill -0 -- -$! 2> /dev/null; do # after an interrupt: until Snakemake has cancelled the jobs
    sleep 0.2
done
exit $status
