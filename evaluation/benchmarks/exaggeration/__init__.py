"""Parts of the benchmark of the surface: accuracy of curvature and of the exaggeration, and linear solvers."""
