"""Error of the linear blend of S_0 and S_gamma_f, and its upper bounds (paper, equations 7 to 9 and appendix)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh

from carigs.exaggeration.exaggerator import Exaggerator


class BlendBound(NamedTuple):
    """Errors of S_blend at one level and their upper bounds; see `blend_bounds`."""

    level: float
    energy: float
    """|grad(S_blend - S_gamma)| relative to |grad S|, in the norm of the system matrix; without unit."""
    energy_bound: float
    """Upper bound of `energy`: root mean square of psi over the surface, less where the surface is stiffer."""
    distance: float
    """Root mean square of |S_blend - S_gamma| over the surface, in the unit of the mesh."""
    distance_bound: float
    """Upper bound of `distance` by Poincaré's inequality from `energy_bound`."""
    distance_uniform: float
    """The same with the largest |psi| instead of its mean square: the step where the paper loses most."""
    distance_paper: float
    """Upper bound by the paper's closed form (equation 9), from the largest |ln K| alone."""


def blend_bounds(exaggerator: Exaggerator, gamma_f: float, levels: Sequence[float]) -> list[BlendBound]:
    """Compute the error of the linear blend and its upper bounds, over the vertices that the equation moves.

    Paper, equations 7 and 8, with alpha = gamma / gamma_f:

        S_blend(gamma) = (1 - alpha) S_0 + alpha S_gamma_f,    delta S = S_blend - S_gamma.

    S_blend solves the equation of the secant weights w_sec = 1 + alpha (|K|^gamma_f - 1). With psi = w_sec - w (paper,
    appendix) the error solves H delta S = W_psi S, where H is the system matrix. H is not softer than W_s, where s >= 1
    is the stiffness of the faces, and |grad S|^2 = 2 on every face, hence

        delta S^T H delta S <= 2 sum_f a_f psi_f^2 / s_f.

    Both surfaces keep their centroid, hence |delta S| <= C_P |grad delta S| (Poincaré's inequality).

    Paper, equation 9, bounds |psi| further:

        |delta S| <= C_P (ln |K|)^2 exp(max(0, gamma_f ln |K|)) gamma (gamma_f - gamma) |grad S|

    at the largest |ln |K||. (It omits a factor 1/2, and so does this function.) Normalised weights are
    exp(gamma ln K - m(gamma)), where m' is a mean of ln K and m'' a variance: then the range of ln K replaces |ln K|.

    Args:
        exaggerator: The solver of the head.
        gamma_f: Level at the end of the blend.
        levels: Levels in [0, gamma_f].

    Returns:
        Errors and bounds at each level.
    """
    solved, faces = exaggerator.solved_vertices, exaggerator.solved_faces
    vertex_areas, areas = exaggerator.areas[solved], exaggerator.face_areas[faces]
    stiffness = exaggerator.laplacian.stiffness()[solved][:, solved].tocsc()
    system, softness = exaggerator.system[solved][:, solved], areas / exaggerator.face_stiffness[faces]
    num_components = len(np.unique(exaggerator.component_labels[solved]))
    # The root mean square of |grad S| is sqrt(2), so this is the bound of a distance per unit of relative strain.
    factor = np.sqrt(2) * poincare_constant(stiffness, vertex_areas, num_components)

    logs = exaggerator.log_curvature[solved]
    max_log = growth = np.ptp(logs) if exaggerator.settings.normalize_weights else 0.0
    if not exaggerator.settings.normalize_weights:
        max_log, growth = np.abs(logs).max(), max(0.0, logs.max())

    start, end = exaggerator.weights(0.0), exaggerator.weights(gamma_f)
    displacement = exaggerator.solve(gamma_f)[solved]
    bounds = []
    for level in levels:
        alpha = level / gamma_f
        psi = ((1 - alpha) * start + alpha * end - exaggerator.weights(level))[faces]
        delta = alpha * displacement - exaggerator.solve(level)[solved]
        strain = np.sqrt((softness * psi**2).sum() / areas.sum())
        bounds.append(
            BlendBound(
                level=float(level),
                energy=float(np.sqrt(max(0.0, (delta * (system @ delta)).sum()) / (2 * areas.sum()))),
                energy_bound=float(strain),
                distance=float(np.sqrt(np.average((delta**2).sum(axis=1), weights=vertex_areas))),
                distance_bound=float(factor * strain),
                distance_uniform=float(factor * np.abs(psi).max()),
                distance_paper=float(factor * max_log**2 * np.exp(gamma_f * growth) * level * (gamma_f - level)),
            )
        )
    return bounds


def poincare_constant(stiffness: csc_array, areas: Float[np.ndarray, " v"], num_components: int = 1) -> float:
    """Poincaré constant C_P: |u| <= C_P |grad u| for functions u of mean zero on each component.

    C_P = 1 / sqrt(lambda_1) with the first positive eigenvalue of W u = lambda A u, with a free (Neumann) boundary.

    Args:
        stiffness: Cotan stiffness W (v, v).
        areas: Area of each vertex's cell, the diagonal of A.
        num_components: Number of connected components.

    Returns:
        C_P, in the unit of length of the mesh.
    """
    shift = 1.0 / areas.sum()  # makes the matrix definite, and is of the eigenvalues' order in any unit
    start = np.random.default_rng(0).normal(size=len(areas))
    values = eigsh(
        stiffness, num_components + 1, diags_array(areas).tocsc(), sigma=-shift, v0=start, return_eigenvectors=False
    )
    return float(1 / np.sqrt(values.max()))
