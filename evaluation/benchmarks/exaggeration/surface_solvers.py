"""Linear solvers for the weighted Poisson equation, on one head at four sizes: factorise, then one level and 32."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from carigs.exaggeration import Exaggerator
from carigs.mesh import linear_solver
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from evaluation.benchmarks.measurement.timing import Measurement, elapsed, median_time

Solve = Callable[[np.ndarray], np.ndarray]
LEVELS = np.linspace(0.25 / 32, 0.25, 32)
SIZES = 4
MOST_VERTICES = {"LU (MMD, symmetric)": 100_000}
"""Largest sizes: on 321169 vertices SciPy's minimum degree ordering takes more than seven minutes."""
MAX_FIRST_LEVEL = 5.0
"""CPU seconds: a solver that takes longer for the first level is not tried at four times the size."""
MAX_ALL_LEVELS = 20.0
"""CPU seconds: if all levels would take longer, their time is extrapolated from the first one."""


def measure_solvers(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Iterator[Measurement]:
    """Time each solver on a head, and after one to three splits of every face into four.

    Args:
        vertices: Vertices of the head.
        faces: Vertex indices of the triangles.

    Yields:
        CPU seconds of all threads; references are those of the first solver, which carigs uses. And the norm of the
        residual over that of the right-hand side.
    """
    too_slow: set[str] = set()
    for _ in range(SIZES):
        cotans = CotanLaplacian(vertices, faces)
        matrix, mass = cotans.stiffness()[1:][:, 1:].tocsc(), mixed_voronoi_areas(vertices, faces)
        right_hand_sides = _right_hand_sides(cotans, vertices, faces)
        first: dict[str, float] = {}
        for name, make in _solvers(matrix, mass).items():
            if name in too_slow or len(vertices) > MOST_VERTICES.get(name, np.inf):
                continue
            times, residual = _times(make, matrix, right_hand_sides)
            case = f"{len(vertices)} vertices, {name}"
            for quantity, value in times.items():
                yield Measurement(case, quantity, "s", value, first.get(quantity))
            yield Measurement(case, "relative residual of one level", "1", residual)
            first = first or times
            if times["one level"] > MAX_FIRST_LEVEL:
                too_slow.add(name)
        vertices, faces = igl.upsample(vertices, faces)
        faces = faces.astype(np.int64)  # libigl returns C's long long, another type to NumPy


def measure_fill_in(case: str, solver: Exaggerator, repeats: int = 5) -> Iterator[Measurement]:
    """Measure LU with symmetric minimum degree ordering on the system of a head, gap stiffness included.

    Args:
        case: Name of the head.
        solver: Its solver.
        repeats: Number of timed calls.

    Yields:
        Entries of the factors and CPU seconds; references are those of COLAMD.
    """
    inside = np.flatnonzero(solver.solved_vertices)[1:]
    matrix = solver.system[inside][:, inside].tocsc()
    orders = (linear_solver.SYMMETRIC, {})
    entries = [float(splu(matrix, **order).nnz) for order in orders]
    times = [median_time(partial(splu, matrix, **order), repeats, time.process_time) for order in orders]
    yield Measurement(case, "entries of LU's factors, symmetric minimum degree", "1", *entries)
    yield Measurement(case, "CPU: LU, symmetric minimum degree", "s", *times)


def _solvers(matrix: csc_array, mass: np.ndarray) -> Mapping[str, Callable[[], Solve]]:
    """Solvers by name; the first is the one that carigs uses."""

    def lu(system: csc_array, **options: object) -> Solve:
        factors = splu(system, **options)
        return lambda right: linear_solver.solve_in_blocks(factors, right)

    def iterate() -> Solve:
        solve = partial(linear_solver.conjugate_gradients, matrix, start=np.zeros(matrix.shape[0]), most=10**5)
        return lambda right: np.stack([solve(column) for column in right.T], axis=1)

    def least_squares() -> Solve:
        # Equation 3 of the paper literally, with L = A^-1 W: the normal equations are those of a bi-Laplacian.
        inverse = diags_array(1 / mass[1:])
        solve = lu((matrix @ inverse @ matrix).tocsc())
        return lambda right: solve(matrix @ (inverse @ right))

    ours = "LU in the order that suits the size" if linear_solver.CholeskySolverD is None else "Cholesky (cholespy)"
    return {
        ours: lambda: linear_solver.CholeskySolver(matrix).solve,
        f"LU (COLAMD), {linear_solver.COLUMNS} columns at once": lambda: lu(matrix),
        "LU (COLAMD), all columns at once": lambda: splu(matrix).solve,
        "LU (MMD, symmetric)": lambda: lu(matrix, **linear_solver.SYMMETRIC),
        "normal equations of the least squares": least_squares,
        "conjugate gradients": iterate,
    }


def _times(
    make: Callable[[], Solve], matrix: csc_array, right_hand_sides: Float[np.ndarray, "n c"]
) -> tuple[dict[str, float], float]:
    """CPU seconds to factorise, and with that for one level (3 columns) and for all of them; relative residual."""
    start = time.process_time()
    solve = make()
    factorised = time.process_time() - start
    right, start = right_hand_sides[:, :3], time.process_time()
    solution = solve(right)
    one = time.process_time() - start
    residual = float(np.linalg.norm(matrix @ solution - right) / np.linalg.norm(right))
    every = len(LEVELS) * one
    if every <= MAX_ALL_LEVELS:
        every = elapsed(lambda: solve(right_hand_sides), time.process_time)
    times = {"factorise": factorised, "one level": factorised + one, "32 levels": factorised + every}
    return times, residual


def _right_hand_sides(
    cotans: CotanLaplacian, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "n c"]:
    """Right-hand sides of all levels, for weights that vary as those of a head."""
    rough = np.sin(40 * vertices / np.ptp(vertices, axis=0).max()).sum(axis=1)[faces].mean(axis=1)
    columns = [cotans.weighted_divergence(vertices, np.exp(level * rough) - 1) for level in LEVELS]
    return np.concatenate(columns, axis=1)[1:]
