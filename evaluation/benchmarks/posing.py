"""Time to pose a head of FLAME's size."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial

import numpy as np

from carigs.head import HeadModel, HeadParameters, pose, pose_frames
from evaluation.benchmarks.measurement.timing import Measurement, median_time

VERTICES, JOINTS, IDENTITIES, EXPRESSIONS = 5143, 5, 300, 100
FRAMES = 100


def flame_sized_head(seed: int = 0) -> tuple[HeadModel, list[HeadParameters]]:
    """A head with FLAME's array sizes, and frames of one person in which every coefficient is used.

    Args:
        seed: Seed of the arrays.

    Returns:
        The model and the frames.
    """
    random, v = np.random.default_rng(seed), VERTICES
    regressor = np.zeros((JOINTS, v), np.float32)
    regressor[:, :: v // 100] = 1 / len(regressor[0, :: v // 100])
    model = HeadModel(
        v_template=random.normal(0, 0.1, (v, 3)).astype(np.float32),
        faces=np.arange(3, dtype=np.int32)[None],
        shapedirs=random.normal(0, 0.001, (v, 3, IDENTITIES + EXPRESSIONS)).astype(np.float32),
        posedirs=random.normal(0, 0.001, (v, 3, 36)).astype(np.float32),
        joint_regressor=regressor,
        weights=random.dirichlet(np.ones(JOINTS), v).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1]),
    )
    shape, offset = random.normal(size=IDENTITIES), random.normal(0, 0.001, (v, 3))
    frames = [
        HeadParameters(
            translation=random.normal(0, 0.1, 3),
            rotation=random.normal(0, 0.1, 3),
            joints=random.normal(0, 0.1, (JOINTS - 1, 3)),
            shape=shape,
            expression=random.normal(size=EXPRESSIONS),
            static_offset=offset,
        )
        for _ in range(FRAMES)
    ]
    return model, frames


def measure_posing() -> Iterator[Measurement]:
    """Measure the CPU time of posing.

    Yields:
        The time of all frames together; the reference is the time of posing them one by one.
    """
    model, frames = flame_sized_head()
    cpu = partial(median_time, clock=time.process_time)
    alone = cpu(lambda: [pose(model, frame) for frame in frames[:5]], repeats=3) * len(frames) / 5
    together = cpu(lambda: pose_frames(model, frames))
    yield Measurement(f"head of {VERTICES} vertices", f"CPU: pose {len(frames)} frames", "s", together, alone)
