"""Compilation of the kernels of later stages while the first stages of a run work.

- `ball_capture`: the capture of a ball, which takes no time to write and to train on
- `compilation`: the stages of a study, run on it
- `process`: the processes that do so beside the jobs of a run
"""
