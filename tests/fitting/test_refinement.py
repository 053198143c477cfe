"""Refinement on rendered images of a small head: outlines and images improve what noisy landmarks give."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_head import ring_of_cameras, small_head

from carigs.capture import OPENCV_FROM_OPENGL
from carigs.capture.images import write_png
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.fitting.footage import frame_projections, read_footage
from carigs.fitting.landmarks.fit import Observations, fit_landmarks
from carigs.fitting.refinement import Refinement
from carigs.fitting.triangulation import project
from carigs.head import SurfacePoints, pose
from carigs.raster import rasterize_mesh

FRAMES = 3
MODEL = small_head(subdivisions=4)
FACE = np.flatnonzero(MODEL.v_template[:, 2] > 0.0)
VERTICES = np.flatnonzero(MODEL.v_template[:, 2] > 0.03)[::40]
LANDMARKS = SurfacePoints.at_vertices(VERTICES)
PARAMETERS = fitted_parameters(MODEL, VERTICES)


def true_frames() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    frames = 0.5 * random.normal(size=(FRAMES, PARAMETERS.frame_size))
    frames[:, :3] *= 0.01
    frames[:, 3:6] *= 0.2
    frames[:, PARAMETERS.joint_slice] *= 0.1
    return frames, random.normal(size=len(PARAMETERS.shape))


def true_vertices() -> np.ndarray:
    frames, shape = true_frames()
    return np.stack([pose(MODEL, PARAMETERS.head_parameters(MODEL, frame, shape)) for frame in frames])


@pytest.fixture(scope="module")
def footage(tmp_path_factory) -> Path:
    """Images whose grey values are waves over the rest position, and mattes."""
    folder, entries = tmp_path_factory.mktemp("footage"), []
    replace(MODEL, regions={"face": FACE}).save(folder / "head_model.npz")
    waves = 0.5 + 0.25 * np.sin(400 * MODEL.v_template).sum(axis=1) / np.sqrt(3)
    for t, vertices in enumerate(true_vertices()):
        for c, camera in enumerate(ring_of_cameras(6)):
            hit = rasterize_mesh(vertices, MODEL.faces, camera)
            inside = hit.face >= 0
            values = np.where(inside, (hit.barycentric * waves[MODEL.faces[hit.face]]).sum(axis=-1), 1.0)
            write_png(folder / f"{t}_{c}.png", np.repeat(values[..., None], 3, axis=2))
            write_png(folder / f"{t}_{c}_matte.png", inside.astype(np.float32))
            entries.append(
                {
                    "timestep_index": t, "camera_index": c, "fl_x": camera.fx, "w": camera.width, "h": camera.height,
                    "transform_matrix": (camera.world_from_camera @ OPENCV_FROM_OPENGL).tolist(),
                    "file_path": f"{t}_{c}.png", "fg_mask_path": f"{t}_{c}_matte.png",
                }
            )  # fmt: skip
    (folder / "transforms.json").write_text(json.dumps({"frames": entries}))
    return folder


def test_footage_without_splits_is_divided(footage):
    capture = read_footage(footage, footage / "head_model.npz")
    splits = {(frame.timestep, frame.camera): frame.split for frame in capture.frames}
    assert {t for (t, _), split in splits.items() if split == "test"} == {2}  # ceil(0.7 * 3) = 3, but one is held out
    assert {c for (_, c), split in splits.items() if split == "val"} == {5}


def test_each_stage_comes_nearer_to_the_truth(footage):
    capture, random = read_footage(footage, footage / "head_model.npz"), np.random.default_rng(1)
    cameras, timesteps = list(range(6)), list(range(FRAMES))
    projections = frame_projections(capture, timesteps, cameras)
    pixels, _ = project(true_vertices()[:, VERTICES], projections)
    pixels += 1.5 * random.normal(size=pixels.shape)
    observations = Observations(pixels, np.ones(pixels.shape[:3]), projections, np.zeros(FRAMES - 1, bool))
    fit = fit_landmarks(MODEL, LANDMARKS, observations)

    def error(fit) -> float:
        found = np.stack([pose(MODEL, parameters) for parameters in fit.parameters(MODEL)])
        return 1000 * np.linalg.norm(found - true_vertices(), axis=-1)[:, FACE].mean()

    work = Refinement(capture, timesteps, cameras, capture.model, LANDMARKS, observations)
    outlines = work.refine_outlines(fit)
    images = work.refine_images(outlines)
    assert error(fit) > error(outlines) > error(images)
    assert error(images) < 0.5 * error(fit)
