"""Heads with known mattes before backgrounds, and the coarse mattes that a network of 256 x 256 pixels gives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from carigs.footage import TimedFrame
from carigs.head import HeadParameters, flame_joints
from carigs.settings import Toy
from carigs.toy.renderer import pose_subject
from carigs.toy.scene import frontal_camera, studio_cameras
from carigs.toy.subject import make_subject
from evaluation.benchmarks.footage.backgrounds import background

NETWORK = 256
CYCLE = 48
"""Frames in which the head turns to both sides and comes back."""


@dataclass
class Scene:
    colours: np.ndarray
    alphas: np.ndarray
    frames: list[TimedFrame]
    coarse: list[np.ndarray]

    def error(self, number: int, alpha: np.ndarray) -> float:
        return float(np.abs(alpha - self.alphas[number])[band(self.alphas[number])].mean())


def weak_matte(alpha: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Without strands, blurred, its outline shifted by up to 3 of 256 pixels and locally by as much, with holes."""
    matte = cv2.resize(alpha.astype(np.float32), (NETWORK, NETWORK), interpolation=cv2.INTER_AREA)
    matte = cv2.morphologyEx(matte, cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)))
    shift = int(rng.integers(-3, 4))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(shift) + 1,) * 2)
    matte = (cv2.dilate if shift > 0 else cv2.erode)(matte, disc)
    field = cv2.GaussianBlur(rng.normal(0, 1, (NETWORK, NETWORK)).astype(np.float32), (0, 0), 14)
    matte = cv2.GaussianBlur(matte, (0, 0), 2.5)
    matte = np.clip(matte + 0.18 * field / field.std() * 4 * matte * (1 - matte), 0, 1)
    if rng.random() < 0.5:
        y, x = (int(value) for value in rng.choice(np.argwhere(matte > 0.9)))
        hole = np.zeros_like(matte)
        cv2.ellipse(hole, (x, y), [int(radius) for radius in rng.integers(3, 8, 2)], 0, 0, 360, 0.8, -1)
        matte *= 1 - cv2.GaussianBlur(hole, (0, 0), 1.5)
    return matte


def band(alpha: np.ndarray, width: int = 10) -> np.ndarray:
    """What is at most so many pixels from the outline."""
    inside = (alpha >= 0.5).astype(np.uint8)
    distances = [cv2.distanceTransform(part, cv2.DIST_L2, 5) for part in (inside, 1 - inside)]
    return np.maximum(*distances) <= width


def toy_head(side: int, count: int, hair: str = "long") -> tuple[np.ndarray, np.ndarray]:
    """Colours and alphas of a toy that turns and talks, at evenly spread times of a cycle."""
    settings = Toy(width=side, height=side, hair=hair, cameras=3, seed=3)
    subject, cameras = make_subject(settings), studio_cameras(settings)
    colours, alphas = [], []
    for phase in 2 * np.pi * np.arange(count) / count:
        parameters = HeadParameters(
            translation=np.array([0.03 * np.sin(phase), 0.004 * np.sin(3 * phase), 0]),
            rotation=np.array([0.10 * np.sin(2 * phase), 0.45 * np.sin(phase), 0.05 * np.sin(phase + 1)]),
            shape=subject.shape,
            joints=flame_joints(jaw=[0.1 * (1 - np.cos(5 * phase)), 0, 0]),
        )
        image, alpha = pose_subject(subject, parameters).render(cameras[frontal_camera(cameras)])
        colours.append(foreground_on_white(image, alpha))
        alphas.append(alpha)
    return np.array(colours), np.array(alphas)


def captured_head(folder: Path, camera: int) -> tuple[np.ndarray, np.ndarray]:
    """Colours and alphas of a camera of a dataset on white."""
    colours, alphas = [], []
    for file in sorted((folder / "images").glob(f"*_{camera:02d}.png")):
        alpha = cv2.imread(str(folder / "fg_masks" / file.name), cv2.IMREAD_GRAYSCALE) / 255
        colours.append(foreground_on_white(cv2.imread(str(file))[..., ::-1] / 255, alpha))
        alphas.append(alpha)
    return np.array(colours), np.array(alphas)


def foreground_on_white(image: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    return ((image - (1 - alpha[..., None])) / np.maximum(alpha, 1e-3)[..., None]).clip(0, 1)


def make_scene(colours: np.ndarray, alphas: np.ndarray, kind: str, seed: int = 0) -> Scene:
    """The head before a background, with the noise of a camera: two levels of 8 bits."""
    rng, (count, height, width) = np.random.default_rng(seed), alphas.shape
    frames = []
    for i, behind in enumerate(background(kind, height, width, count, rng)):
        exact = alphas[i, ..., None] * colours[i] + (1 - alphas[i, ..., None]) * behind
        noisy = (exact + rng.normal(0, 2 / 255, exact.shape)).clip(0, 1)
        frames.append(TimedFrame(i, i / 25, np.rint(255 * noisy).astype(np.uint8)))
    return Scene(colours, alphas, frames, [weak_matte(alpha, rng) for alpha in alphas])
