"""A small avatar for tests: random surfels on the ball of `miniature`, posed, lit, with a path of four nodes."""

from __future__ import annotations

import numpy as np
import torch
from miniature import ball_model

from carigs.capture import Camera, look_at
from carigs.exaggeration.gamma_path import GammaPath, lobatto_levels
from carigs.head import HeadParameters
from carigs.light import Shading, fibonacci_sphere
from carigs.splat.avatar import Avatar
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels, flat_discs

CAMERA = Camera(look_at(np.array([0.15, 0.1, 0.6]), np.zeros(3)), 150, 150, 32, 32, 64, 64)
TIMESTEPS = 3


def ball_sequence(*, lit: bool = True) -> HeadSequence:
    """Three poses with expressions; the path bends, twists and swells the ball, and is not linear in the level."""
    model = ball_model(subdivisions=2)
    neutral = model.v_template.astype(np.float64)
    x, y, z = neutral.T
    levels = lobatto_levels(4, 0.25)
    growth = np.stack([2 * x * y, 0.5 * y + 3 * z * x, z * (1 + 10 * x)], axis=1)
    path = GammaPath(
        levels,
        np.stack([(level + 3 * level**2 - 4 * level**3) * growth for level in levels]).astype(np.float32),
        model.faces,
        neutral,
    )
    parameters = {
        t: HeadParameters(
            translation=np.array([0.01 * t, 0, -0.02 * t]),
            rotation=np.array([0.2, 0.4 * t, -0.1]),
            expression=0.5 * t * np.eye(100)[0],
        )
        for t in range(TIMESTEPS)
    }
    sequence = HeadSequence(model, parameters, path)
    if lit:
        light = np.linspace(0.5, 1.5, 17)[:, None] * [1.0, 0.9, 0.8]
        sequence.shading = Shading(fibonacci_sphere(16), light, 1.0, 2.0, np.zeros(len(model.faces), bool))
    return sequence


def random_surfels(n: int, faces: int, sh_degree: int = 3, seed: int = 0) -> Surfels:
    rng = np.random.default_rng(seed)
    binding = rng.integers(0, faces, n)
    surfels = flat_discs(
        binding, 0.5 * rng.normal(size=(n, 3)), 0.5 * rng.random(n) + 0.3, 0.6, rng.random((n, 3)), sh_degree
    )
    for _, value in surfels.attributes():
        value.data += 0.2 * torch.from_numpy(rng.standard_normal(tuple(value.shape))).float()
    return surfels


def ball_avatar(
    *, sh_degree: int = 3, skinning: str = "jbs", rotate_harmonics: bool = True, lit: bool = True
) -> Avatar:
    sequence = ball_sequence(lit=lit)
    surfels = random_surfels(600, len(sequence.head.faces), sh_degree)
    return Avatar(surfels, sequence, skinning, rotate_harmonics)


def basis_values(directions: np.ndarray) -> np.ndarray:
    """Real spherical harmonics of degrees 1 to 3 as in the tables of 3D Gaussian Splatting, written out again."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    return np.stack(
        [
            -np.sqrt(3 / (4 * np.pi)) * y,
            np.sqrt(3 / (4 * np.pi)) * z,
            -np.sqrt(3 / (4 * np.pi)) * x,
            np.sqrt(15 / (4 * np.pi)) * x * y,
            -np.sqrt(15 / (4 * np.pi)) * y * z,
            np.sqrt(5 / (16 * np.pi)) * (2 * z**2 - x**2 - y**2),
            -np.sqrt(15 / (4 * np.pi)) * x * z,
            np.sqrt(15 / (16 * np.pi)) * (x**2 - y**2),
            -np.sqrt(35 / (32 * np.pi)) * y * (3 * x**2 - y**2),
            np.sqrt(105 / (4 * np.pi)) * x * y * z,
            -np.sqrt(21 / (32 * np.pi)) * y * (4 * z**2 - x**2 - y**2),
            np.sqrt(7 / (16 * np.pi)) * z * (2 * z**2 - 3 * x**2 - 3 * y**2),
            -np.sqrt(21 / (32 * np.pi)) * x * (4 * z**2 - x**2 - y**2),
            np.sqrt(105 / (16 * np.pi)) * z * (x**2 - y**2),
            -np.sqrt(35 / (32 * np.pi)) * x * (x**2 - 3 * y**2),
        ],
        axis=-1,
    )
