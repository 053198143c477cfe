"""A miniature subject for tests: a bumpy ball with two eyes, seen by three cameras, in the GaussianAvatars layout."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from carigs.capture import OPENCV_FROM_OPENGL, Camera, look_at
from carigs.capture.images import write_png
from carigs.head import HeadModel, HeadParameters, pose
from carigs.raster import rasterize_mesh

SIZE = (40, 48)  # width, height
FRONTAL = Camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 100, 100, 32, 24, 64, 48)


def sheet(n: int = 12, width: float = 0.4, height: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """A flat grid of triangles in z = 0 that faces +z."""
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, n), np.linspace(-height / 2, height / 2, n))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack([np.column_stack([i, i + 1, i + n + 1]), np.column_stack([i, i + n + 1, i + n])])
    return vertices, faces.astype(np.int32)


def picture(camera: Camera) -> np.ndarray:
    """An image that bilinear sampling reproduces exactly: colours affine in the pixel position."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([x / 100, y / 100, 0.3 + 0.002 * x - 0.003 * y], axis=-1).astype(np.float32)


def ball_model(subdivisions: int = 3) -> HeadModel:
    """A head of 0.1 m radius whose upper part is scalp; expression 0 (jawOpen) pulls the lower part down."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.1)
    vertices = mesh.vertices * (1 + 0.08 * np.sin(25 * mesh.vertices[:, :1]))
    v = len(vertices)
    shapedirs = np.zeros((v, 3, 400), np.float32)
    shapedirs[:, :, 0] = 0.01 * vertices / 0.1
    shapedirs[:, 1, 300] = -0.02 * (vertices[:, 1] < -0.03)
    weights = np.zeros((v, 5), np.float32)
    weights[:, 0] = 1
    regressor = np.full((5, v), 1 / v, np.float32)
    front = vertices[:, 2] > 0.05
    return HeadModel(
        v_template=vertices.astype(np.float32),
        faces=np.asarray(mesh.faces, np.int32),
        shapedirs=shapedirs,
        posedirs=np.zeros((v, 3, 36), np.float32),
        joint_regressor=regressor,
        weights=weights,
        parents=np.array([-1, 0, 1, 1, 1]),
        regions={
            "scalp": np.flatnonzero(vertices[:, 1] > 0.06),
            "face": np.flatnonzero(front & (vertices[:, 1] <= 0.06)),
            "neck": np.flatnonzero(vertices[:, 1] < -0.07),
        },
        expression_names=("jawOpen",),
    )


def ball_cameras() -> dict[int, Camera]:
    """Three frontal views 1 m away; camera 1 is the validation view."""
    width, height = SIZE
    return {
        i: Camera(look_at(np.array([x, 0.05, 1.0]), np.zeros(3)), 150, 150, width / 2, height / 2, width, height)
        for i, x in enumerate((-0.4, 0.0, 0.4))
    }


def bust_model() -> HeadModel:
    """The ball with a nose, one ear and a chin: no turn and no mirror leaves it as it is."""
    ball = ball_model()
    x, y, z = ball.v_template.T
    nose = 0.05 * np.exp(-((x**2 + (y + 0.01) ** 2) / 0.0008)) * (z > 0)
    ear = 0.04 * np.exp(-((z**2 + (y - 0.02) ** 2) / 0.001)) * (x > 0)
    chin = 0.05 * np.exp(-((x**2 + (z - 0.03) ** 2) / 0.002)) * (y < 0)
    return replace(ball, v_template=ball.v_template + np.stack([ear, -chin, nose], axis=1).astype(np.float32))


def bust_with_nose() -> HeadModel:
    """The bust with its nose as a region."""
    bust = bust_model()
    x, y, z = bust.v_template.T
    nose = np.flatnonzero((x**2 + (y + 0.01) ** 2 < 0.03**2) & (z > 0))
    return replace(bust, regions={**bust.regions, "nose": nose})


def bust_cameras() -> dict[int, Camera]:
    """Five views at several heights; x, y and the distance differ."""
    width, height = 2 * SIZE[0], 2 * SIZE[1]
    centres = [(-0.7, 0.2, 0.8), (-0.3, -0.2, 1.1), (0.0, 0.1, 1.0), (0.4, 0.3, 0.9), (0.6, -0.1, 0.7)]
    return {
        i: Camera(look_at(np.array(centre), np.zeros(3)), 280, 280, width / 2, height / 2, width, height)
        for i, centre in enumerate(centres)
    }


def write_ball(
    folder: Path,
    timesteps: int = 4,
    model: HeadModel | None = None,
    cameras: dict[int, Camera] | None = None,
    step: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Path:
    """Write a capture of the ball (coloured by position) and its `head_model.npz`; the last timestep is EXP-2."""
    if (timesteps, model, cameras, step) == (4, None, None, (0.0, 0.0, 0.0)):
        return _write_files(folder, _plain_ball())
    return _make_ball(folder, timesteps, model, cameras, step)


@cache
def _plain_ball() -> dict[str, bytes]:
    """Contents of the files that most tests ask for."""
    with TemporaryDirectory() as name:
        made = _make_ball(Path(name) / "ball", 4, None, None, (0.0, 0.0, 0.0))
        return {str(file.relative_to(made)): file.read_bytes() for file in made.rglob("*.*")}


def _write_files(folder: Path, contents: dict[str, bytes]) -> Path:
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def _make_ball(
    folder: Path,
    timesteps: int,
    model: HeadModel | None,
    cameras: dict[int, Camera] | None,
    step: tuple[float, float, float],
) -> Path:
    model, cameras = model or ball_model(), cameras or ball_cameras()
    for name in ("images", "fg_masks", "flame_param"):
        (folder / name).mkdir(parents=True)
    model.save(folder / "head_model.npz")
    entries: dict[str, list[dict]] = {"train": [], "val": [], "test": []}
    for t in range(timesteps):
        rotation, translation = np.array([0, 0.1 * t, 0]), t * np.array(step)
        parameters = HeadParameters(rotation=rotation, translation=translation, expression=np.eye(100)[0] * 0.3 * t)
        parameters.save(folder / f"flame_param/{t:05d}.npz", model)
        vertices = pose(model, parameters)
        for c, camera in cameras.items():
            hit = rasterize_mesh(vertices, model.faces, camera)
            albedo = 0.5 + 4 * model.v_template  # colour = rest position
            points = np.einsum("hwc,hwcx->hwx", hit.barycentric, albedo[model.faces[hit.face]])
            name = f"{t:05d}_{c:02d}.png"
            write_png(folder / "images" / name, np.where(hit.face[..., None] >= 0, points, 1.0))
            write_png(folder / "fg_masks" / name, (hit.face >= 0).astype(np.float32))
            split = "test" if t == timesteps - 1 else "val" if c == 1 else "train"
            entries[split].append(
                {
                    "timestep_index": t,
                    "camera_index": c,
                    "cx": camera.cx,
                    "cy": camera.cy,
                    "fl_x": camera.fx,
                    "fl_y": camera.fy,
                    "w": camera.width,
                    "h": camera.height,
                    "transform_matrix": (camera.world_from_camera @ OPENCV_FROM_OPENGL).tolist(),
                    "file_path": f"images/{name}",
                    "fg_mask_path": f"fg_masks/{name}",
                    "flame_param_path": f"flame_param/{t:05d}.npz",
                    "sequence": "EXP-2" if split == "test" else "EMO-1",
                }
            )
    for split, frames in entries.items():
        (folder / f"transforms_{split}.json").write_text(json.dumps({"frames": frames}))
    return folder
