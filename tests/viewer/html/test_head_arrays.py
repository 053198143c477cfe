"""The head of the page: its sums of rows are the vertices that the head model poses."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from avatars import TIMESTEPS, ball_sequence
from viewer.html.unpacking import unpacked

from carigs.exaggeration import Caricature
from carigs.exaggeration.gamma_path import GammaPath, lagrange_weights
from carigs.head.posing import unposed_frames
from carigs.viewer.html.head_arrays import head_arrays
from carigs.viewer.html.light_arrays import LEVELS, TOLERANCE, light_arrays
from carigs.viewer.html.packed_arrays import deflated

MICROMETRE = 1e-6


@pytest.fixture(scope="module")
def sequence():
    """The ball, whose expression and pose correctives change along the path."""
    sequence = ball_sequence(lit=True)
    path, rng = sequence.path, np.random.default_rng(0)
    changes = 0.01 * rng.normal(size=(len(path.levels) - 1, 1, *path.neutral.shape)).astype(np.float32)
    sequence.path = GammaPath(
        path.levels, path.displacements, path.faces, path.neutral, columns=np.array([0]), changes=changes
    )
    return sequence


@pytest.fixture(scope="module")
def region(sequence) -> GammaPath:
    """A path of its own, which moves the upper half."""
    path = sequence.path
    moved = path.displacements * (path.neutral[:, 1:2] > 0).astype(np.float32)
    return GammaPath(0.8 * path.levels, moved, path.faces, path.neutral)


def sums(arrays, name, rows) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints that rows with weights add."""
    coefficients = sum(weight * arrays[f"{name}_coefficients"][row] for row, weight in rows)
    joints = sum(weight * arrays[f"{name}_joints"][row] for row, weight in rows)
    return (coefficients @ arrays[f"{name}_basis"].T).reshape(-1, 3), joints.reshape(-1, 3)


def weights(levels, level) -> list[float]:
    barycentric = [1 / np.prod([x - y for y in levels if y != x]) for x in levels]
    return lagrange_weights(list(zip(levels, barycentric, strict=True)), level)


@pytest.mark.parametrize("place", range(TIMESTEPS))
@pytest.mark.parametrize(("level", "region_level"), [(0.0, 0.0), (0.25, 0.0), (0.11, 0.0), (0.28, 0.0), (0.1, 0.17)])
def test_sums_of_rows_are_the_head_before_its_joints_turn(sequence, region, place, level, region_level):
    timesteps = [2, 0, 1]
    header, packed = head_arrays(sequence, timesteps, {"upper": region})
    arrays = unpacked(*deflated(packed))
    own, moved = weights(header["levels"], level), weights(header["regions"][0]["levels"], region_level)
    vertices, joints = sums(arrays, "clip", [(place, 1), *((place + k * TIMESTEPS, own[k]) for k in range(1, 4))])
    local, local_joints = sums(arrays, "region0", [(k - 1, moved[k]) for k in range(1, 4)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = sequence.path.at(level)
        displacement = whole.displacement + region.displacement(region_level)
    caricature = Caricature(displacement, whole.columns, whole.changes)
    expected, expected_joints, _ = unposed_frames(sequence.head, [sequence.parameters[timesteps[place]]], caricature)
    found = sequence.head.v_template + vertices + local
    assert np.abs(found - expected[0]).max() < 20 * MICROMETRE
    assert np.abs(joints + local_joints - expected_joints[0]).max() < MICROMETRE


def test_the_light_is_exact_where_it_was_computed(sequence, region):
    """At both ends at every timestep, and at all levels at the first; of a region at its end."""
    timesteps = [0, 1, 2]
    header, packed, _ = light_arrays(sequence, timesteps, {"upper": region})
    arrays = unpacked(*deflated(packed))
    rows = arrays["light_coefficients"] @ arrays["light_basis"].T
    mean = arrays["light_mean"].ravel()
    levels = header["lightLevels"]

    def error(found, timestep, level):
        expected = sequence.shade(timestep, level).ravel()
        assert np.ptp(expected) > 0.05
        return np.sqrt(np.mean((found - expected) ** 2))

    for t in timesteps:
        assert error(mean + rows[t], t, 0.0) < 3 * TOLERANCE
        assert error(mean + rows[len(timesteps) + t], t, sequence.path.gamma_f) < 3 * TOLERANCE
    for k in range(1, LEVELS - 1):
        share = k / (LEVELS - 1)
        straight = (1 - share) * rows[0] + share * rows[len(timesteps)]
        assert error(mean + straight + rows[2 * len(timesteps) + k - 1], 0, levels[k]) < 3 * TOLERANCE
    assert np.abs(arrays["light_region0"]).max() > 0.05


def test_without_light_there_is_nothing_to_pack(sequence, region):
    dark = ball_sequence(lit=False)
    assert light_arrays(dark, [0], {"upper": region}) == ({"lightLevels": []}, [], None)
