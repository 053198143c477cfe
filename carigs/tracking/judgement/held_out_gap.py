"""How far the head poses of held-out frames of tracked footage lie from those of its training frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

from carigs.capture.held_out_poses import PoseGap, facing, pose_gap
from carigs.tracking.dataset import tracked_cameras, tracked_splits
from carigs.tracking.footage_tracking import FootageTrack
from carigs.tracking.recording import Recording


def tracked_pose_gap(
    track: FootageTrack, recordings: Sequence[Recording], by_time: Callable[[int], list[str]]
) -> PoseGap:
    """Compare the head poses of test frames with those of training frames.

    Args:
        track: The tracked head.
        recordings: The frames.
        by_time: Names the split of each tracked timestep of a clip.

    Returns:
        How far they lie apart, as `carigs.capture.held_out_poses.capture_pose_gap` finds of the dataset.
    """
    cameras = tracked_cameras(track, recordings)
    names = tracked_splits(track, cameras, by_time)
    places = [*product(range(len(track.kept)), range(len(cameras)))]
    turns = facing(track.head.model, [track.head.parameters[t] for t, _ in places], [cameras[c] for _, c in places])
    train, test = ([i for i, (t, c) in enumerate(places) if names[t][c] == split] for split in ("train", "test"))
    return pose_gap(turns[train], turns[test])
