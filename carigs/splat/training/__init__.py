"""Losses, supervision, optimisation, density control and checkpoints."""
