"""A synthetic person in the layout of NeRSemble's data as pre-processed for GaussianAvatars.

Sequences side by side and a union of them by relative paths; FLAME's file, with teeth added by the tracker; static
offsets with and without teeth; cameras that are moved with the mean head of each sequence; principal points off the
middle, cy counted from below as since November 2024; a camera that misses a timestep; mattes that end below the neck.
"""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import numpy as np
from head.test_teeth import FACES, VERTICES
from scipy.sparse import csc_matrix

from carigs.capture import OPENCV_FROM_OPENGL, Camera, look_at
from carigs.capture.images import write_png
from carigs.head import HeadModel, HeadParameters, pose
from carigs.raster import rasterize_mesh

SUBJECT = "074"
UNION = f"UNION10_{SUBJECT}_EMO1234EXP234589_v16_DS2-0.5x_lmkSTAR_teethV3_SMOOTH_offsetS_whiteBg_maskBelowLine"
SEQUENCES = ("EMO-1", "EXP-2", "EXP-3", "EMO-4")
"""The last one is held out in the released data of this person."""
STEPS = 2
CAMERAS = {0: -1.0, 4: -0.4, 8: 0.0, 12: 0.7}
"""Angle of each camera in radians."""
SIZE = (96, 140)
MISSING = (1, 4)
"""Timestep and camera without an image."""
MASK_LINE = 0.86


def flame_arrays() -> dict[str, np.ndarray]:
    """A head of FLAME's numbers: 5023 vertices, 9976 faces, 3 components."""
    random, v = np.random.default_rng(2), VERTICES.copy()
    v[:, [0, 2]] *= (0.1 + np.sqrt(1 - (v[:, 1:2] / 0.13) ** 2)) / 1.1
    shapedirs = np.zeros((len(v), 3, 400))
    shapedirs[:, :, 0], shapedirs[:, :, 1] = 0.02 * v, 0.01 * v * [1, 0, 0]
    shapedirs[:, 1, 300] = -0.004 * (v[:, 1] < -0.03)
    shapedirs[:, 2, 301] = 0.004 * (np.abs(v[:, 1]) < 0.05) * (v[:, 2] > 0)
    regressor = np.full((5, len(v)), 1 / len(v)) + 1e-6 * random.normal(size=(5, len(v)))
    return {
        "v_template": v,
        "f": FACES.astype(np.uint32),
        "shapedirs": shapedirs,
        "posedirs": np.zeros((len(v), 3, 36)),
        "J_regressor": csc_matrix(regressor),
        "weights": np.eye(5)[np.where(v[:, 1] < -0.09, 0, 1)],
        "kintree_table": np.array([[2**32 - 1, 0, 1, 1, 1], [0, 1, 2, 3, 4]], np.int64),
    }


def regions(v: np.ndarray) -> dict[str, np.ndarray]:
    """Vertex numbers as in FLAME_masks.pkl."""
    return {
        "scalp": np.flatnonzero(v[:, 1] > 0.07),
        "face": np.flatnonzero((np.abs(v[:, 1]) < 0.07) & (v[:, 2] > 0.05)),
        "neck": np.flatnonzero(v[:, 1] < -0.09),
    }


def write_nersemble(folder: Path) -> Path:
    """Write the person.

    Args:
        folder: Folder to write to: what the environment variable NERSEMBLE names.

    Returns:
        The union folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    arrays = flame_arrays()
    (folder / "flame2023.pkl").write_bytes(pickle.dumps(arrays))
    (folder / "FLAME_masks.pkl").write_bytes(pickle.dumps(regions(arrays["v_template"])))
    model = HeadModel.load(folder / "flame2023.pkl")
    offset = 5e-4 * np.sin(30 * model.v_template)
    offset[len(arrays["v_template"]) :] = 0
    shape = np.zeros(300)
    shape[:2] = 0.5, -0.3
    united: dict[str, list[dict]] = {"train": [], "val": [], "test": []}
    for s, sequence in enumerate(SEQUENCES):
        name = f"{SUBJECT}_{sequence}_v16_DS2-0.5x_lmkSTAR_teethV3_SMOOTH_offsetS_whiteBg_maskBelowLine"
        own: list[dict] = []
        for k in range(STEPS):
            t = s * STEPS + k
            frames = _write_timestep(folder / name, model, t, k, s, shape, offset)
            own += [{**entry, "timestep_index": k, "timestep_id": f"{k:05d}"} for entry in frames]
            for entry in frames:
                split = "test" if s == len(SEQUENCES) - 1 else "val" if entry["camera_index"] == 8 else "train"
                paths = {key: f"../{name}/{value}" for key, value in entry.items() if key.endswith("_path")}
                united[split].append({**entry, **paths, "timestep_index": t})
        _write_transforms(folder / name, {split: [] for split in united} | {"train": own})
    _write_transforms(folder / UNION, united)
    (folder / UNION / "sequences_test.txt").write_text(SEQUENCES[-1])
    return folder / UNION


def _write_timestep(
    folder: Path, model: HeadModel, t: int, k: int, s: int, shape: np.ndarray, offset: np.ndarray
) -> list[dict]:
    """Write images, mattes and parameters of a timestep, and return its entries."""
    for kind in ("images", "fg_masks", "flame_param"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    mean = np.array([0.002 * s, -0.001 * s, 0.003])  # subtracted from head and cameras of this sequence
    expression = np.zeros(100)
    expression[:2] = k, 0.5 * s
    parameters = HeadParameters(
        translation=np.array([0.001 * k, 0, 0]) - mean,
        rotation=np.array([0.02 * s, 0.15 * k, 0]),
        shape=shape,
        expression=expression,
        static_offset=offset,
    )
    parameters.save(folder / f"flame_param/{k:05d}.npz", model)
    if s == 1:  # tracked before teeth were added
        with np.load(folder / f"flame_param/{k:05d}.npz") as content:
            arrays = dict(content)
        arrays["static_offset"] = arrays["static_offset"][:, :5023]
        np.savez(folder / f"flame_param/{k:05d}.npz", **arrays)
    vertices, entries = pose(model, parameters), []
    for c, angle in CAMERAS.items():
        if (t, c) == MISSING:
            continue
        centre = np.array([np.sin(angle), 0.1, np.cos(angle)])
        camera_from_world = look_at(centre - mean, -mean)
        w, h = SIZE
        camera = Camera(camera_from_world, 330.0 + c, 330.0 + c, w / 2 + 2.5, h / 2 - 6.0 - 0.1 * c, w, h)
        hit = rasterize_mesh(vertices, model.faces, camera)
        colours = 0.45 + 2 * model.v_template + 0.1 * np.sin(200 * model.v_template)
        points = np.einsum("hwc,hwcx->hwx", hit.barycentric, colours[model.faces[hit.face]])
        matte = (hit.face >= 0) & (np.arange(h)[:, None] < MASK_LINE * h)
        name = f"{k:05d}_{c:02d}.png"
        write_png(folder / "images" / name, np.where(matte[..., None], np.clip(points, 0.05, 0.85), 1.0))
        write_png(folder / "fg_masks" / name, matte.astype(np.float32))
        entries.append(
            {
                "timestep_index_original": k,
                "camera_index": c,
                "camera_id": f"2222000{c:02d}",
                "cx": camera.cx,
                "cy": h - camera.cy,
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "h": h,
                "w": w,
                "camera_angle_x": 2 * math.atan(w / (2 * camera.fx)),
                "camera_angle_y": 2 * math.atan(h / (2 * camera.fy)),
                "transform_matrix": (camera.world_from_camera @ OPENCV_FROM_OPENGL).tolist(),
                "file_path": f"images/{name}",
                "fg_mask_path": f"fg_masks/{name}",
                "flame_param_path": f"flame_param/{k:05d}.npz",
            }
        )
    return entries


def _write_transforms(folder: Path, splits: dict[str, list[dict]]) -> None:
    folder.mkdir(exist_ok=True)
    for split, frames in splits.items():
        shared = {key: frames[-1][key] for key in ("cx", "cy", "fl_x", "fl_y", "h", "w") if frames}
        indices = {
            "timestep_indices": sorted({entry["timestep_index"] for entry in frames}),
            "camera_indices": sorted({entry["camera_index"] for entry in frames}),
        }
        (folder / f"transforms_{split}.json").write_text(json.dumps({**shared, **indices, "frames": frames}, indent=4))
    np.savez(folder / "canonical_flame_param.npz", jaw_pose=np.array([[0.3, 0, 0]]))
