"""What a reader of the documents has: captures, a head model, a mesh with regions, and a trained point cloud."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import trimesh
from dome_captures import DomeBust, write_ava256
from miniature import ball_model, write_ball
from ply_oracle import GAUSSIAN_AVATARS, write_random_ply

from carigs.head import HeadModel


def write_captures(folder: Path) -> None:
    """Write what the documents name below `/data`: `anna`, `UNION10_306`, `ava256`, `ga` and `flame2023.npz`."""
    write_ball(folder / "anna")
    write_ball(folder / "UNION10_306", timesteps=8)
    write_ava256(folder / "ava256", DomeBust())
    (folder / "anna/head_model.npz").rename(folder / "flame2023.npz")
    model = HeadModel.load(folder / "flame2023.npz")
    (folder / "ga").mkdir()
    write_random_ply(folder / "ga/point_cloud.ply", GAUSSIAN_AVATARS, len(model.faces), n=500)
    sizes = {"translation": 3, "rotation": 3, "neck_pose": 3, "jaw_pose": 3, "eyes_pose": 6}
    timesteps = 4  # of the ball
    np.savez(
        folder / "ga/flame_param.npz",
        **{name: np.zeros((timesteps, size)) for name, size in sizes.items()},
        shape=np.zeros(300),
        expr=0.3 * np.arange(timesteps)[:, None] * np.eye(100)[0],
        static_offset=np.zeros((1, len(model.v_template), 3)),
        dynamic_offset=np.zeros((timesteps, len(model.v_template), 3)),
    )


def write_mesh_with_regions(folder: Path) -> None:
    """Write `head.obj` and its regions, as `masks.json` and as FLAME's pickle of arrays."""
    model = ball_model()
    trimesh.Trimesh(model.v_template, model.faces, process=False).export(folder / "head.obj")
    x, y, z = model.v_template.T
    regions = {"nose": np.flatnonzero((z > 0.07) & (abs(y) < 0.05)), "ears": np.flatnonzero(abs(x) > 0.08)}
    (folder / "masks.json").write_text(json.dumps({name: ids.tolist() for name, ids in regions.items()}))
    (folder / "FLAME_masks.pkl").write_bytes(pickle.dumps(regions, protocol=2))
