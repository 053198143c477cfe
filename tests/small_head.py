"""A small head for tests of fitting: a bumpy ellipsoid with smooth random blendshapes and FLAME's joints."""

from __future__ import annotations

import numpy as np
import trimesh

from carigs.capture import Camera, look_at
from carigs.head import HeadModel

IDENTITIES, EXPRESSIONS = 6, 5


def small_head(seed: int = 0, subdivisions: int = 3) -> HeadModel:
    """Radius about 0.1 m. The jaw turns the lower front, pose correctives are small, and blendshapes move 4 mm."""
    random = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    unit = np.array(mesh.vertices)
    vertices = unit * [0.08, 0.11, 0.1] * (1 + 0.05 * np.sin(5 * unit[:, :1] + 3 * unit[:, 1:2]))

    def smooth(count: int) -> np.ndarray:
        waves = np.sin(unit @ random.normal(size=(3, 8)) * 2 + random.uniform(0, 6, 8))
        return np.einsum("vw,wib->vib", waves, random.normal(size=(8, 3, count))) / np.sqrt(8)

    jaw = np.clip(-2 * unit[:, 1], 0, 1) * np.clip(2 * unit[:, 2], 0, 1)
    neck = np.clip(1 + unit[:, 1], 0, 1) * (1 - jaw)
    weights = np.stack([1 - jaw - neck, neck, jaw, 0 * jaw, 0 * jaw], axis=1)
    regressor = np.exp(-np.linalg.norm(vertices - np.array([[0, -0.1, 0], [0, -0.08, 0], [0, -0.02, 0.02],
                                                            [-0.03, 0.02, 0.08], [0.03, 0.02, 0.08]])[:, None],
                                       axis=2) / 0.01)  # fmt: skip
    return HeadModel(
        v_template=vertices.astype(np.float32),
        faces=np.asarray(mesh.faces, np.int32),
        shapedirs=(0.004 * smooth(IDENTITIES + EXPRESSIONS)).astype(np.float32),
        posedirs=(0.002 * smooth(36)).astype(np.float32),
        joint_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        weights=weights.astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1]),
        num_identity=IDENTITIES,
    )


def ring_of_cameras(count: int = 6, size: int = 200, focal: float = 700.0) -> list[Camera]:
    """Cameras in front, 1 m away, up to 60 degrees to the sides."""
    cameras = []
    for i, angle in enumerate(np.linspace(-1.05, 1.05, count)):
        centre = np.array([np.sin(angle), 0.3 * (-1) ** i, np.cos(angle)])
        cameras.append(Camera(look_at(centre, np.zeros(3)), focal, focal, size / 2, size / 2, size, size))
    return cameras
