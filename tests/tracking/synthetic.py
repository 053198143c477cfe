"""What a tracker without errors would know of synthetic footage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from carigs.detection import mesh_indices as mesh
from carigs.footage import TimedFrame
from carigs.footage.measures import measure_frames
from carigs.tracking.judgement.quality import TrackedFrames, face_sharpness, head_angles, openings
from evaluation.benchmarks.footage.truth import FootageTruth

IBUG = {
    **dict(zip(np.ravel(mesh.LIP_GAPS).tolist(), (62, 66, 61, 67, 63, 65), strict=True)),
    **dict(zip(np.ravel(mesh.LEFT_LID_GAPS[1:]).tolist(), (38, 40, 37, 41), strict=True)),
    **dict(zip(np.ravel(mesh.RIGHT_LID_GAPS[1:]).tolist(), (43, 47, 44, 46), strict=True)),
    **{mesh.LEFT_LID_GAPS[0][i]: n for i, n in enumerate((37, 41))},
    **{mesh.RIGHT_LID_GAPS[0][i]: n for i, n in enumerate((44, 46))},
    **{mesh.LEFT_EYE[0]: 36, mesh.LEFT_EYE[8]: 39, mesh.RIGHT_EYE[0]: 45, mesh.RIGHT_EYE[8]: 42},
}
"""MediaPipe's landmarks of lids and lips among the 68 of iBUG."""


def judged(truth: FootageTruth, images: Sequence[np.ndarray] | None = None) -> TrackedFrames:
    """Without images, they are as sharp and as bright as can be."""
    heads, count = truth.vertices(), len(truth.parameters)
    times = np.arange(count) / truth.fps
    places = np.array([truth.model.landmarks68.interpolate(head) for head in heads])
    landmarks = np.full((count, mesh.COUNT, 3), np.nan)
    landmarks[:, list(IBUG)] = places[:, list(IBUG.values())]
    mouth, eyes = openings(landmarks)
    cameras = [seen[0] for seen in truth.cameras]
    face = np.array([camera.project(points)[0] for camera, points in zip(cameras, places, strict=True)])
    low, high = face.min(axis=1), face.max(axis=1)
    above_chin = truth.model.v_template[:, 1] > truth.model.v_template[truth.model.landmarks68.corners[8, 0], 1]
    outside = np.zeros(count)
    for t, camera in enumerate(cameras):
        pixels = camera.project(heads[t][above_chin])[0]
        outside[t] = 1 - ((pixels > 0) & (pixels < (camera.width, camera.height))).all(axis=1).mean()
    sharpness, exposure = np.full(count, 200.0), np.zeros(count)
    if images is not None:
        boxes = np.concatenate([low, high], axis=1).astype(int)
        sharpness = np.array([face_sharpness(i, tuple(b)) for i, b in zip(images, boxes.tolist(), strict=True)])
        exposure = measure_frames(TimedFrame(t, times[t], image) for t, image in enumerate(images)).exposure
    middles = np.array([camera.to_camera(head).mean(axis=0) for camera, head in zip(cameras, heads, strict=True)])
    yaw, pitch = head_angles(truth.camera_from_head(0), middles)
    return TrackedFrames(
        numbers=np.arange(count), times=times, left_out=("",) * count, yaw=yaw, pitch=pitch,
        errors={"all": np.zeros(count)}, face_width=(high - low)[:, 0], outside=outside, mouth=mouth, eyes=eyes,
        sharpness=sharpness, exposure=exposure,
    )  # fmt: skip
