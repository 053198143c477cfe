"""Landmarks in another unit or order are named; those in pixels pass, whatever the person and the unit of cameras."""

import re
from pathlib import Path

import numpy as np
import pytest
from miniature import bust_cameras
from shared_data import DATA, needs_data

from carigs.capture import read_dataset
from carigs.errors import InputError
from carigs.fitting.footage import frame_projections, frame_sizes
from carigs.fitting.landmarks.convention import LARGEST_ERROR, check_convention, check_residuals, face_sizes
from carigs.fitting.landmarks.fit import Observations
from carigs.fitting.landmarks.orders import mirror_partners
from carigs.fitting.triangulation import project, projection_matrices
from carigs.fitting.unit import check_unit
from carigs.head import pose

CAMERAS = list(bust_cameras().values())
SIZES = np.array([[(camera.width, camera.height) for camera in CAMERAS]] * 3, float)
WIDTH, HEIGHT = np.moveaxis(SIZES[:, :, None], -1, 0)
X, Y = (lambda p: p[..., 0]), (lambda p: p[..., 1])


def stacked(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack([x, y], axis=-1)


def seen(noise: float = 0.0, unit: float = 1.0) -> tuple[np.ndarray, Observations]:
    """Landmarks of a face that has no symmetry, and another person's in the images of three timesteps."""
    random = np.random.default_rng(0)
    template = random.normal(size=(30, 3)) * [0.05, 0.07, 0.03]
    person = template + 0.003 * random.normal(size=template.shape)
    heads = np.stack([person + 0.01 * t for t in range(3)])
    projections = np.stack([projection_matrices(CAMERAS)] * 3)
    pixels, _ = project(heads, projections)
    pixels += noise * random.normal(size=pixels.shape)
    projections[..., 3] /= unit
    return template, Observations(pixels, np.ones(pixels.shape[:3]), projections, np.ones(2, bool))


def check(template: np.ndarray, observations: Observations, pixels: np.ndarray) -> None:
    changed = Observations(pixels, observations.confidence, observations.projections, observations.linked)
    check_convention(template, changed, SIZES, "landmarks.npz")


@pytest.mark.parametrize("noise", [0, 0.5, 1])
@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_landmarks_in_pixels_pass(noise, unit):
    template, observations = seen(noise, unit)
    check(template, observations, observations.pixels)


MISTAKES = {
    "shares of the image": (lambda p: stacked(X(p) / WIDTH, Y(p) / HEIGHT), "are shares of the image's size"),
    "from -1 to 1": (lambda p: 2 * stacked(X(p) / WIDTH, Y(p) / HEIGHT) - 1, "run from -1 to 1"),
    "twice the resolution": (lambda p: 2 * p, "belong to images of twice the resolution"),
    "half the resolution": (lambda p: p / 2, "belong to images of half the resolution"),
    "four times the resolution": (lambda p: 4 * p, "belong to images of four times the resolution"),
    "row, column": (lambda p: p[..., ::-1], "have y before x"),
    "y up": (lambda p: stacked(X(p), HEIGHT - Y(p)), "have y from the bottom"),
    "mirrored": (lambda p: stacked(WIDTH - X(p), Y(p)), "have x from the right"),
    "upside down": (lambda p: stacked(WIDTH - X(p), HEIGHT - Y(p)), "are turned by 180 degrees"),
    "shares, y up": (
        lambda p: stacked(X(p) / WIDTH, 1 - Y(p) / HEIGHT),
        "are shares of the image's size and have y from the bottom",
    ),
    "shares, row first": (
        lambda p: stacked(Y(p) / HEIGHT, X(p) / WIDTH),
        "have y before x .* and are shares of the image's size",
    ),
    "half the resolution, row first": (lambda p: p[..., ::-1] / 2, "have y before x .* and belong to images of half"),
}


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", MISTAKES)
@pytest.mark.parametrize("unit", [1.0, pytest.param(0.01, marks=pytest.mark.slow)])
def test_the_mistake_is_named(name, unit):
    change, says = MISTAKES[name]
    template, observations = seen(0.5, unit)
    with pytest.raises(InputError, match=rf"^landmarks\.npz: landmarks: the landmarks {says}.*; remedy: ") as caught:
        check(template, observations, change(observations.pixels))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("length", [480, 1e4])
def test_shares_of_another_length_are_named(length):
    template, observations = seen()
    with pytest.raises(InputError, match=r"are shares of about .* pixels .*multiply x and y by about (\d+)") as caught:
        check(template, observations, observations.pixels / length)
    assert float(re.search(r"by about ([\d.e+]+)", str(caught.value))[1]) == pytest.approx(length, rel=0.03)


def test_shares_in_one_camera_are_no_pixels():
    template, observations = seen()
    observations.confidence[:, 1:] = 0
    check(template, observations, observations.pixels)
    with pytest.raises(InputError, match="they are no pixels"):
        check(template, observations, observations.pixels / 480)


# Landmarks of a symmetric face, as detectors' are.

RIGHT = np.random.default_rng(3).normal(size=(12, 3)) * [0.05, 0.07, 0.02] + [0.05, 0, 0]
MIDDLE = np.random.default_rng(4).normal(size=(6, 3)) * [0, 0.07, 0.02] + [0, 0, 0.03]
FACE = np.concatenate([RIGHT, MIDDLE, RIGHT * [-1, 1, 1]])
PARTNERS = np.concatenate([np.arange(18, 30), np.arange(12, 18), np.arange(12)])
SIDE = max(CAMERAS[0].width, CAMERAS[0].height)


def face(seed: int = 0, noise: float = 0.3) -> Observations:
    """Another person's landmarks: proportions differ by 2 % of the face."""
    random = np.random.default_rng(seed)
    person = FACE + 0.002 * random.normal(size=FACE.shape)
    projections = np.stack([projection_matrices(CAMERAS)] * 3)
    pixels, _ = project(np.stack([person + 0.01 * t for t in range(3)]), projections)
    pixels += noise * random.normal(size=pixels.shape)
    return Observations(pixels, np.ones(pixels.shape[:3]), projections, np.ones(2, bool))


def corners(p: np.ndarray) -> np.ndarray:
    """Upper left corners of a crop of each image, around the face."""
    return np.floor(p.min(axis=2, keepdims=True)) - 4


OTHERS = {
    "square": (lambda p: 448 * stacked(X(p) / WIDTH, Y(p) / HEIGHT), r"resized to 448 x 448 .*multiply x by w / 448"),
    "oblong": (lambda p: stacked(640 * X(p) / WIDTH, 320 * Y(p) / HEIGHT), r"resized to 640 x 320"),
    "percent": (lambda p: 100 * stacked(X(p) / WIDTH, Y(p) / HEIGHT), r"are percent of the image's size"),
    "1.25 times": (lambda p: 1.25 * p, r"1\.25 times the resolution .*multiply x and y by 0\.8"),
    "0.8 times": (lambda p: 0.8 * p, r"0\.8 times the resolution .*multiply x and y by 1\.25"),
    "eight times": (lambda p: 8 * p, r"eight times the resolution"),
    "mirror partners": (lambda p: p[:, :, PARTNERS], r"the landmarks have left and right exchanged"),
    "mirrored images": (
        lambda p: stacked(WIDTH - X(p), Y(p))[:, :, PARTNERS],
        r"have x from the right and have left and right exchanged .*write w - x, then exchange the indices",
    ),
    "quarter turn": (lambda p: stacked(Y(p), WIDTH - X(p)), r"have y before x .* and have x from the right"),
    "crop": (lambda p: p - np.array([14, 0]), r"are shifted by about -14 pixels in x.*add 14 to x"),
    "from the middle": (lambda p: p - stacked(WIDTH, HEIGHT) / 2, r"count from the middle of the image"),
    "a crop of each": (lambda p: p - corners(p), r"(count from another corner|belong to another crop)"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_another_mistake_is_named(name):
    change, says = OTHERS[name]
    observations = face()
    check(FACE, observations, observations.pixels)
    with pytest.raises(InputError, match=rf"^landmarks\.npz: landmarks: .*{says}") as caught:
        check(FACE, observations, change(observations.pixels))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_an_order_of_no_meaning_blames_nothing_else(seed):
    observations = face()
    shuffled = observations.pixels[:, :, np.random.default_rng(seed).permutation(len(FACE))]
    with pytest.raises(InputError, match=r"no unit, origin or order explains the landmarks.*compare their order"):
        check(FACE, observations, shuffled)


def test_a_small_head_between_cameras_around_it_is_the_unit_of_the_cameras():
    observations = face()
    observations.projections[..., 3] /= 2
    check(FACE, observations, observations.pixels)
    with pytest.raises(InputError, match=r"see --metres-per-unit$"):
        check_unit(FACE, observations, Path("cameras.json"))


def test_partners_are_those_of_the_symmetry():
    np.testing.assert_array_equal(mirror_partners(FACE), PARTNERS)
    assert mirror_partners(seen()[0]) is None


def test_missing_landmarks_take_no_part():
    template, observations = seen(0.5)
    observations.confidence[:, ::2, ::3] = 0
    observations.pixels[:, ::2, ::3] = 0
    check(template, observations, observations.pixels)
    with pytest.raises(InputError, match="twice the resolution"):
        check(template, observations, 2 * observations.pixels)


def test_the_size_of_a_face_is_that_of_its_landmarks():
    _, observations = seen()
    points = observations.pixels[0, 2]
    assert face_sizes(observations)[2] == pytest.approx(np.sqrt(points.var(axis=0).sum()), rel=0.05)


@pytest.mark.parametrize(
    ("shares", "says"),
    [
        ([0.02] * 5, None),
        ([0.09] * 5, None),
        ([0.02, 0.02, 0.02, 0.9, 0.9], None),  # two cameras: `fit` warns of them
        ([0.15] * 5, "15% of the size of the face, in 5 of 5 cameras"),
        ([0.02, 0.02, 0.4, 0.2, 0.2], "40% of .*, in 3 of 5 cameras"),
        ([np.nan, np.nan, np.nan, 0.02, 0.2], "20% of .*, in 1 of 2 cameras"),
        ([np.nan] * 5, None),
    ],
)
def test_errors_that_no_face_has_are_refused(shares, says):
    assert max(0.02, 0.09) < LARGEST_ERROR < 0.15
    _, observations = seen()
    residuals = np.array(shares) * face_sizes(observations)
    if says is None:
        check_residuals(residuals, observations, "landmarks.npz")
    else:
        with pytest.raises(InputError) as caught:
            check_residuals(residuals, observations, "landmarks.npz")
        assert re.search(rf"landmarks\.npz: landmarks: the fitted head is .* pixels off .*{says}", str(caught.value))


@pytest.mark.slow
@needs_data
@pytest.mark.parametrize("name", ["ict_s1", "ict_s7"])
@pytest.mark.parametrize("cameras", [1, 2, 3, 16])
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_right_landmarks_of_people_pass(name, cameras, unit):
    capture = read_dataset(DATA / name, DATA / "ict_model.npz")
    random, points = np.random.default_rng(cameras), capture.model.landmarks68
    timesteps = sorted(capture.parameter_files)[::10]
    views = np.sort(random.choice(sorted(capture.cameras), cameras, replace=False)).tolist()
    projections, sizes = (find(capture, timesteps, views) for find in (frame_projections, frame_sizes))
    heads = np.stack([points.interpolate(pose(capture.model, capture.parameters(t))) for t in timesteps])
    pixels, _ = project(heads, projections)
    projections[..., 3] /= unit
    for noise, outliers, hidden in ((0, 0, 0), (3, 0, 0), (3, 0.2, 0), (1, 0.2, 0.5)):
        seen = random.random(pixels.shape[:3]) >= hidden
        wrong = random.random((*pixels.shape[:3], 1)) < outliers
        noisy = pixels + noise * random.normal(size=pixels.shape) + wrong * random.uniform(-60, 60, pixels.shape)
        observations = Observations(noisy * seen[..., None], seen.astype(float), projections, np.ones(2, bool))
        check_convention(points.interpolate(capture.model.v_template), observations, sizes, "landmarks.npz")
