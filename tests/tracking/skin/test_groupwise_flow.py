"""Flows that move images onto their mean: of images that were moved by flows that are known."""

import cv2
import numpy as np
import pytest

from carigs.tracking.skin.face_chart import UnwrappedFrame
from carigs.tracking.skin.groupwise_flow import flows_to_mean

SIDE, COUNT = 144, 12
GRID = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).astype(np.float32)
WHOLE = np.ones((SIDE, SIDE), np.float32)
INNER = np.s_[:, 20:-20, 20:-20]


def texture(seed: int) -> np.ndarray:
    """Noise with details of two pixels and more."""
    noise = np.random.default_rng(seed).normal(size=(SIDE, SIDE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return smooth / smooth.std()


def smooth_flows(size: float) -> np.ndarray:
    """Flows whose mean over the images is 0, with a standard deviation in pixels."""
    noise = np.random.default_rng(1).normal(size=(COUNT, SIDE, SIDE, 2)).astype(np.float32)
    flows = np.stack([cv2.GaussianBlur(flow, (0, 0), 14) for flow in noise])
    flows -= flows.mean(axis=0)
    return size * flows / flows.std()


def moved(image: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Image that shows at x + flow(x) what the given one shows at x."""
    inverse = -flow
    for _ in range(10):
        inverse = -cv2.remap(flow, GRID + inverse, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return cv2.remap(image, GRID + inverse, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def test_flows_are_found():
    true, image = smooth_flows(0.8), texture(0)
    flows = flows_to_mean([UnwrappedFrame(moved(image, flow), WHOLE) for flow in true])
    wrong = np.linalg.norm(flows - true, axis=-1)[INNER]
    assert np.linalg.norm(true, axis=-1)[INNER].mean() > 0.8
    assert wrong.mean() < 0.25
    assert np.abs(flows.mean(axis=0)[INNER[1:]]).max() < 0.02


def test_equal_images_stay():
    assert np.abs(flows_to_mean([UnwrappedFrame(texture(0), WHOLE)] * 3)).max() < 1e-3


def test_nothing_moves_where_there_is_no_texture():
    images = [np.random.default_rng(i).normal(0, 0.02, (SIDE, SIDE)).astype(np.float32) for i in range(6)]
    assert np.abs(flows_to_mean([UnwrappedFrame(image, WHOLE) for image in images])).mean() < 0.05


def test_pixels_without_weight_do_not_count():
    true, image = smooth_flows(0.8), texture(0)
    frames = []
    for i, flow in enumerate(true):
        weight, shown = WHOLE.copy(), moved(image, flow)
        place = np.s_[30:70, 10 * (i % 6) + 30 : 10 * (i % 6) + 60]
        weight[place], shown[place] = 0, texture(i + 2)[place]  # a hand, say
        frames.append(UnwrappedFrame(shown, weight))
    wrong = np.linalg.norm(flows_to_mean(frames) - true, axis=-1)
    shown = np.stack([frame.weight > 0 for frame in frames])
    assert wrong[INNER][shown[INNER]].mean() < 0.3


@pytest.mark.parametrize("wrinkled", [0, 5])
def test_a_wrinkle_moves_nothing(wrinkled):
    """What one image alone shows is an outlier."""
    images = [texture(0) for _ in range(COUNT)]
    images[wrinkled] = images[wrinkled].copy()
    images[wrinkled][70:73, 40:100] -= 2.0
    flows = flows_to_mean([UnwrappedFrame(image, WHOLE) for image in images])
    assert np.abs(flows[wrinkled]).mean() < 0.05
    assert np.abs(np.delete(flows, wrinkled, axis=0)).max() < 0.3
