"""What the numbers of a card are that no metric of a frame is: sizes, times and memory."""

from __future__ import annotations

from evaluation.tables.metric import Catalogue, Metric

AVATAR_MEASURES: Catalogue = {
    "surfels": Metric("Surfels", "neither", 0, "", "number of surfels of the avatar; n counts avatars, one per seed"),
    "avatar_bytes": Metric(
        "Size",
        "lower",
        0,
        "bytes",
        "size of avatar.npz, which renders every level by itself; n counts avatars, one per seed",
    ),
    "frame_seconds": Metric(
        "Time of a frame",
        "lower",
        4,
        "s",
        "mean time of posing, shading, skinning and rasterising a frame of the stage render at its resolution, but for "
        "the first, which loads compiled kernels; n counts the levels of each training",
    ),
    "frames_per_second": Metric(
        "FPS", "higher", 1, "1/s", "1 / time of a frame, without loading, metrics and compression to PNG"
    ),
}
"""Measures of one avatar, in the order of the columns."""
STAGE_MEASURES: Catalogue = {
    "stage_seconds": Metric("Time", "lower", 1, "s", "wall time, summed over the jobs of the stage"),
    "stage_cpu_seconds": Metric(
        "CPU time", "lower", 1, "s", "processor time of all threads, summed over the jobs of the stage"
    ),
    "stage_peak_memory": Metric(
        "Peak memory", "lower", 0, "MB", "largest resident memory of a job's process, over the jobs of the stage"
    ),
}
"""Measures of one stage, in the order of the columns."""
