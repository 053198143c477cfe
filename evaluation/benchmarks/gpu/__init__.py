"""What a GPU does: one program that builds, checks and measures the backend `cuda`, in parts with a time limit each.

- `__main__`: the command line; `runner`: each part in a process of its own
- `figures`: one measured figure, and the file of a part's figures
- `document`: the table of a report for docs/gpu.md
- `wheels`: collects the packages that a machine without a network lacks

The parts: `machine`, `kernels` (gsplat's are compiled), `checks` (tests), `trainings`, `frames` and `networks`.
"""
