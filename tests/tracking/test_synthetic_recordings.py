"""Synthetic videos that break one rule of docs/recording.md each: the advice names that rule."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from tracking.synthetic import judged

from carigs.settings import Toy
from carigs.toy import head_model, make_subject
from carigs.toy.rig.attributes import sample_attributes
from carigs.tracking.judgement.advice import advice
from evaluation.benchmarks.footage.backgrounds import background
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.rendering import NOISE, before, person
from evaluation.benchmarks.footage.scenes import orbit, talk
from evaluation.benchmarks.footage.truth import FootageTruth

SIDE, SEED, FPS = 448, 2, 10.0
GOOD = Talk(seconds=11, fps=FPS, seed=SEED)


def footage(motion: Talk = GOOD, **changes) -> FootageTruth:
    return talk(head_model(), sample_attributes(SEED).shape, SIDE, motion, **changes)


def aside(truth: FootageTruth, pixels: float) -> FootageTruth:
    """The camera looks past the person."""
    moved = [[replace(camera, cx=camera.cx + pixels) for camera in seen] for seen in truth.cameras]
    return replace(truth, cameras=moved)


def beginnings(lines: list[str]) -> list[str]:
    return [line.split(":")[0] for line in lines]


BROKEN = {
    "none": (footage, []),
    "left": (lambda: footage(replace(GOOD, yaw=(-35, 10))), ["Turn your head farther to the left"]),
    "never turns": (
        lambda: footage(replace(GOOD, yaw=(-6, 6))),
        ["Turn your head farther to the left", "Turn your head farther to the right"],
    ),
    "never nods": (
        lambda: footage(replace(GOOD, pitch=(-2, 3))),
        ["Raise your chin farther", "Lower your chin farther"],
    ),
    "never speaks": (lambda: footage(replace(GOOD, mouth=0.05)), ['Open your mouth wide, as for a long "ah"']),
    "never blinks": (
        lambda: footage(replace(GOOD, blinks=False, pitch=(-12, 13))),
        ["Blink, and close your eyes for a second"],
    ),
    "short": (lambda: footage(replace(GOOD, seconds=4)), ["Record longer, about 20 seconds"]),
    "tiny head": (lambda: footage(distance=3.0), ["Move the camera closer or record at a higher resolution"]),
    "leaves the image": (lambda: aside(footage(), 120), ["Keep the whole head in the image"]),
}


@pytest.mark.parametrize("rule", BROKEN)
def test_what_the_person_does(rule):
    make, expected = BROKEN[rule]
    assert beginnings(advice(judged(make()))) == expected


def test_an_orbit_is_asked_for_nothing_that_a_still_person_cannot_do():
    truth = orbit(head_model(), sample_attributes(SEED).shape, SIDE, GOOD)
    assert advice(judged(truth), moving_camera=True) == []


@pytest.fixture(scope="module")
def pictures():
    """The truth, and the frames before the camera's noise."""
    subject = make_subject(Toy(seed=SEED, supersampling=1, texture_size=512, hair_strands=1500))
    truth = talk(subject.model, subject.shape, SIDE, GOOD)
    behind = background("books", SIDE, SIDE, len(truth.parameters), np.random.default_rng(0))
    return truth, [image for image, _ in before(person(subject, truth), behind)]


def noisy(image: np.ndarray) -> np.ndarray:
    return (image + np.random.default_rng(1).normal(0, NOISE, image.shape)).clip(0, 255).round().astype(np.uint8)


@pytest.mark.slow
def test_what_the_camera_does(pictures):
    truth, images = pictures
    assert advice(judged(truth, images)) == []
    blurred = [noisy(cv2.GaussianBlur(image, (0, 0), 3)) for image in images]
    assert beginnings(advice(judged(truth, blurred))) == ["Focus on the face and clean the lens"]
    shaken = [noisy(cv2.blur(image, (15, 1))) if 20 <= t < 40 else image for t, image in enumerate(images)]
    assert beginnings(advice(judged(truth, shaken))) == ["Move more slowly or use more light"]
    darker = [np.uint8(image * 0.55) if t > 60 else image for t, image in enumerate(images)]
    assert beginnings(advice(judged(truth, darker))) == ["Lock the exposure and keep the light as it is"]
