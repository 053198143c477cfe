"""Ways to solve the equation's system, on one head at four sizes: factorise, then one level and 32."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from carigs.exaggeration import Exaggerator
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.linear_solver import (
    COLUMNS,
    SYMMETRIC,
    CholeskySolver,
    CholeskySolverD,
    conjugate_gradients,
    solve_in_blocks,
)
from evaluation.benchmarks.measurements import Measurement, seconds

Solve = Callable[[np.ndarray], np.ndarray]
LEVELS = np.linspace(0.25 / 32, 0.25, 32)
SIZES = 4
MOST_VERTICES = {"LU (MMD, symmetric)": 100_000}
"""Of ways that do not grow evenly: on 321169 vertices SciPy's MMD searched for an order for more than seven minutes."""
SLOW = 5.0
"""CPU seconds: what takes longer for the first level is not tried at four times the size."""
TOLD = 20.0
"""CPU seconds: levels that would take longer are told by the first one."""


def size_rows(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Iterator[Measurement]:
    """Times of each way at this size and after one to three splits of every face into four.

    Times are the process's own, all threads together; a reference is that of the first way.
    """
    left_out: set[str] = set()
    for _ in range(SIZES):
        cotans = CotanLaplacian(vertices, faces)
        matrix, mass = cotans.stiffness()[1:][:, 1:].tocsc(), mixed_voronoi_areas(vertices, faces)
        rights = _right_hand_sides(cotans, vertices, faces)
        first: dict[str, float] = {}
        for name, make in _ways(matrix, mass).items():
            if name in left_out or len(vertices) > MOST_VERTICES.get(name, np.inf):
                continue
            times = _times(make, rights)
            for quantity, value in times.items():
                yield Measurement(f"{len(vertices)} vertices, {name}", quantity, "s", value, first.get(quantity))
            first = first or times
            if times["one level"] > SLOW:
                left_out.add(name)
        vertices, faces = (
            array.astype(kind) for array, kind in zip(igl.upsample(vertices, faces), (float, np.int64), strict=True)
        )


def order_rows(case: str, solver: Exaggerator, repeats: int = 5) -> Iterator[Measurement]:
    """The symmetric minimum degree on a head's own system, air included; the references are COLAMD's."""
    inside = np.flatnonzero(solver.solved_vertices)[1:]
    matrix = solver.system[inside][:, inside].tocsc()
    entries = [float(splu(matrix, **order).nnz) for order in (SYMMETRIC, {})]
    times = [
        seconds(lambda order=order: splu(matrix, **order), repeats, time.process_time) for order in (SYMMETRIC, {})
    ]
    yield Measurement(case, "entries of LU's factors, symmetric minimum degree", "1", *entries)
    yield Measurement(case, "CPU: LU, symmetric minimum degree", "s", *times)


def _ways(matrix: csc_array, mass: np.ndarray) -> Mapping[str, Callable[[], Solve]]:
    """What is measured, first of all what `carigs.surface` does."""

    def lu(system: csc_array, **options: object) -> Solve:
        factors = splu(system, **options)
        return lambda right: solve_in_blocks(factors, right)

    def all_at_once() -> Solve:
        return splu(matrix).solve

    def iterate() -> Solve:
        start = np.zeros(matrix.shape[0])
        return lambda right: np.stack([conjugate_gradients(matrix, c, start, 10**5) for c in right.T], axis=1)

    def least_squares() -> Solve:
        # Equation 3 as it is written, over A^-1 W: its normal equations are a bi-Laplacian's.
        inverse = diags_array(1 / mass[1:])
        solve = lu((matrix @ inverse @ matrix).tocsc())
        return lambda right: solve(matrix @ (inverse @ right))

    ours = "LU in the order that suits the size" if CholeskySolverD is None else "Cholesky (cholespy)"
    return {
        ours: lambda: CholeskySolver(matrix).solve,
        f"LU (COLAMD), {COLUMNS} columns at once": lambda: lu(matrix),
        "LU (COLAMD), all columns at once": all_at_once,
        "LU (MMD, symmetric)": lambda: lu(matrix, **SYMMETRIC),
        "normal equations of the least squares": least_squares,
        "conjugate gradients": iterate,
    }


def _times(make: Callable[[], Solve], rights: Float[np.ndarray, "n c"]) -> dict[str, float]:
    """CPU seconds to factorise, and with that for one level (3 columns) and for all of them."""
    start = time.process_time()
    solve = make()
    factorised = time.process_time() - start
    start = time.process_time()
    solve(rights[:, :3])
    one = time.process_time() - start
    if len(LEVELS) * one > TOLD:
        return {"factorise": factorised, "one level": factorised + one, "32 levels": factorised + len(LEVELS) * one}
    start = time.process_time()
    solve(rights)
    return {
        "factorise": factorised,
        "one level": factorised + one,
        "32 levels": factorised + time.process_time() - start,
    }


def _right_hand_sides(
    cotans: CotanLaplacian, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "n c"]:
    """Of all levels, for weights that vary as those of a head do."""
    rough = np.sin(40 * vertices / np.ptp(vertices, axis=0).max()).sum(axis=1)[faces].mean(axis=1)
    columns = [cotans.weighted_divergence(vertices, np.exp(level * rough) - 1) for level in LEVELS]
    return np.concatenate(columns, axis=1)[1:]
