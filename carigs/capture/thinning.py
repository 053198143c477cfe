"""Fewer frames: every n-th timestep of a sequence, and at most so many frames of a split."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.frame import Frame
from carigs.readers.file_names import SPLITS


def thin_frames(frames: Sequence[Frame], stride: int = 1, max_frames: int | None = None) -> tuple[Frame, ...]:
    """Leave out timesteps.

    Args:
        frames: Frames sorted by timestep.
        stride: Every n-th timestep of each sequence is kept, from the first on.
        max_frames: Largest number of frames of each split. The timesteps that are kept are spread evenly; at least one
            is kept. None: all.

    Returns:
        The frames that are kept, in their order.
    """
    sequences: dict[str, list[int]] = {}
    for frame in frames:
        timesteps = sequences.setdefault(frame.sequence, [])
        if frame.timestep not in timesteps[-1:]:
            timesteps.append(frame.timestep)
    strided = {timestep for timesteps in sequences.values() for timestep in timesteps[::stride]}
    kept = [frame for frame in frames if frame.timestep in strided]
    if max_frames is None:
        return tuple(kept)
    chosen = {
        (split, t) for split in SPLITS for t in spread_timesteps([f for f in kept if f.split == split], max_frames)
    }
    return tuple(frame for frame in kept if (frame.split, frame.timestep) in chosen)


def spread_timesteps(frames: Sequence[Frame], max_frames: int) -> list[int]:
    """Choose timesteps that are spread evenly.

    Args:
        frames: Some frames.
        max_frames: Largest number of their frames at the chosen timesteps.

    Returns:
        As many timesteps as that number allows, but at least one, sorted.
    """
    counts = Counter(frame.timestep for frame in frames)
    timesteps = sorted(counts)
    for number in range(min(len(timesteps), max_frames), 1, -1):
        chosen = evenly_spread(timesteps, number)
        if sum(counts[t] for t in chosen) <= max_frames:
            return chosen
    return timesteps[:1]
