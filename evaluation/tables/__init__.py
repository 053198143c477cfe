"""Metric records, their means with bootstrap intervals, and the comparison tables (table 1 of the paper).

- `csv_files`: named tuples as CSV files
- `metric_records`: one value per metric, region and frame
- `metric`: title, direction and definition of a metric, and its table
- `factors`: what varies at random between frames: subjects, timesteps, cameras, trainings
- `bootstrap`: confidence intervals of means
- `summary`: means and paired differences over frames
- `published`: the paper's own values
- `typeset`: the comparison tables
- `document`: tables as Markdown and LaTeX

Nothing is re-exported: `summary` imports pandas, which jobs that only write records do not need.
"""
