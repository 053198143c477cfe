"""What our parts cost and how accurate they are, as tidy rows.

- `measurements`: the rows, and their CSV file
- `clocks`, `chart`: times of functions that run by turns; the plot beside the rows
- `surface`: the exaggeration: time against error; `surface_solvers`, `surface_accuracy`, `surface_chart`: its parts
- `splat`: the surfel engine beside plain loops and torch; `training`: whole steps
- `scenes`, `pairs`: what is drawn, and how many surfels contribute to how many pixels
"""
