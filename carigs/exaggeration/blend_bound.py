"""The error of the paper's linear blend of S_0 and S_gamma_f, and what bounds it (paper, equation 9 and appendix)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh

if TYPE_CHECKING:
    from carigs.exaggeration.exaggerator import Exaggerator


class BlendBound(NamedTuple):
    """Errors of S_blend at one level, each with what bounds it; see `blend_bounds`."""

    level: float
    energy: float
    """|grad(S_blend - S_gamma)| relative to |grad S|, in the norm of the system: a strain, without unit."""
    energy_bound: float
    """At most this: the root mean square of psi over the surface, less where the surface is stiffer."""
    distance: float
    """Root mean square of |S_blend - S_gamma| over the surface, in the unit of the mesh."""
    distance_bound: float
    """At most this, by Poincaré's inequality from `energy_bound`."""
    distance_uniform: float
    """The same with the largest |psi| instead of its mean square: the step where the paper loses most."""
    distance_paper: float
    """The paper's closed form, from the largest |ln K| alone."""


def blend_bounds(solver: Exaggerator, gamma_f: float, levels: Sequence[float]) -> list[BlendBound]:
    """The blend's error and its bounds at levels in [0, gamma_f], over the vertices that the equation moves.

    With psi = w_sec - w, the difference of the secant weight and the exact one, delta S = S_blend - S_gamma solves
    A delta S = W_psi S.  The system A is no softer than W_s, with s >= 1 the stiffness of the faces, and |grad S|^2 = 2
    on every face, so delta S^T A delta S <= 2 sum_f a_f psi_f^2 / s_f.  Since both surfaces keep their centroid,
    |delta S| <= C_P |grad delta S|.

    The paper's form bounds |psi| further by (ln K)^2 e^max(0, gamma_f ln K) gamma (gamma_f - gamma), all at the largest
    |ln K| (it leaves out a factor 1/2, and so does this).  Weights that are divided by their area mean are e^(gamma
    ln K - m(gamma)), where m' is a mean of ln K and m'' a variance: then the range of ln K takes the place of |ln K|.
    """
    inside = solver.solved
    faces = inside[solver.faces].all(axis=1)
    areas, stiffness = solver.face_areas[faces], solver.cotans.stiffness()[inside][:, inside].tocsc()
    system, soft = solver.system[inside][:, inside], areas / solver.face_stiffness[faces]
    connected = len(np.unique(solver.component[inside]))
    # |grad S| = sqrt(2) in the root mean square, so that this is the bound of a distance per unit of relative strain.
    reach = np.sqrt(2) * poincare_constant(stiffness, solver.areas[inside], connected)

    logs = solver.log_curvature[inside]
    steep = growth = np.ptp(logs) if solver.settings.normalize_weights else 0.0
    if not solver.settings.normalize_weights:
        steep, growth = np.abs(logs).max(), max(0.0, logs.max())

    start, end, moved = solver.weights(0.0), solver.weights(gamma_f), solver.solve(gamma_f)[inside]
    bounds = []
    for level in levels:
        share = level / gamma_f
        psi = ((1 - share) * start + share * end - solver.weights(level))[faces]
        delta = share * moved - solver.solve(level)[inside]
        strain = np.sqrt((soft * psi**2).sum() / areas.sum())
        bounds.append(
            BlendBound(
                level=float(level),
                energy=float(np.sqrt(max(0.0, (delta * (system @ delta)).sum()) / (2 * areas.sum()))),
                energy_bound=float(strain),
                distance=float(np.sqrt(np.average((delta**2).sum(axis=1), weights=solver.areas[inside]))),
                distance_bound=float(reach * strain),
                distance_uniform=float(reach * np.abs(psi).max()),
                distance_paper=float(reach * steep**2 * np.exp(gamma_f * growth) * level * (gamma_f - level)),
            )
        )
    return bounds


def poincare_constant(stiffness: csc_array, areas: Float[np.ndarray, " v"], connected: int = 1) -> float:
    """C_P of |u| <= C_P |grad u| for u of mean zero on each of the `connected` components: 1 / sqrt(lambda_1).

    lambda_1 is the first eigenvalue above 0 of W u = lambda M u (Neumann's: the boundary is free).
    """
    shift = 1.0 / areas.sum()  # makes the stiffness definite; of the eigenvalues' order, whatever the mesh's unit
    start = np.random.default_rng(0).normal(size=len(areas))
    values = eigsh(
        stiffness, connected + 1, diags_array(areas).tocsc(), sigma=-shift, v0=start, return_eigenvectors=False
    )
    return float(1 / np.sqrt(values.max()))
