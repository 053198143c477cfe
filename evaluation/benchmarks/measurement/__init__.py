"""What benchmarks measure with: timing by turns, scenes and trainings of known size, and plots of the records."""
