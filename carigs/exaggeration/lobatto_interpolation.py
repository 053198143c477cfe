"""Polynomials through a few levels: Chebyshev-Lobatto nodes and the barycentric formula."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def lobatto_levels(count: int, gamma_f: float) -> Float[np.ndarray, "k"]:
    """The extrema of Chebyshev's polynomial between 0 and gamma_f, both included."""
    return gamma_f * (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2


def barycentric(levels: Float[np.ndarray, "k"]) -> list[tuple[float, float]]:
    """Nodes and their weights 1 / prod(x_j - x_k)."""
    differences = levels[:, None] - levels[None, :]
    np.fill_diagonal(differences, 1.0)
    return list(zip(levels.tolist(), (1.0 / differences.prod(axis=1)).tolist(), strict=True))


def lagrange_weights(formula: list[tuple[float, float]], level: float) -> list[float]:
    """Share of each node at a level (Berrut and Trefethen 2004, equation 4.2)."""
    # A handful of numbers: NumPy would take longer to be called than Python to compute.
    level = float(level)
    for node, _ in formula:
        if node == level:
            return [float(other == level) for other, _ in formula]
    terms = [weight / (level - node) for node, weight in formula]
    total = sum(terms)
    return [term / total for term in terms]
