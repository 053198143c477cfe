"""Mattes of discs and of strands before known backgrounds, against the truth."""

import cv2
import numpy as np
import pytest

from carigs.errors import CarigsError
from carigs.footage import TimedFrame
from carigs.matting import composite, matted_frames
from carigs.matting.background import FEWEST_SEEN, NOISE, UNKNOWN, clean_plate, plain_background
from carigs.matting.closed_form import closed_form_alpha
from carigs.matting.difference import difference_prior
from carigs.matting.foreground import foreground_colours
from carigs.matting.mattes import largest_region, refined_alpha
from carigs.matting.steadiness import ImageMotion, SteadyMatte
from carigs.matting.trimap import trimap

SIDE = 128


def disc(x=64.0, radius=30.0):
    """Alpha of a disc with strands on its upper side, by samples of 4 x 4 in each pixel."""
    scale = 4
    image = np.zeros((SIDE * scale, SIDE * scale), np.uint8)
    centre = np.array([x, 64.0])
    cv2.circle(image, np.rint(scale * centre).astype(int).tolist(), round(scale * radius), 255, -1)
    for angle in np.linspace(-2.6, -0.5, 12):
        way = np.array([np.cos(angle), np.sin(angle)])
        ends = [np.rint(scale * (centre + r * way)).astype(int).tolist() for r in (radius - 4, radius + 7)]
        cv2.line(image, *ends, 255, 5)
    return cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA).astype(np.float32) / 255


def wall(busy, seed=0):
    """A wall under a lamp, or books."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    if not busy:
        return np.stack([0.7 + 0.1 * x, 0.72 - 0.1 * y, 0.75 - 0.08 * x * y], axis=-1)
    books = np.random.default_rng(seed).uniform(0.05, 0.95, (4, 20, 3))
    return cv2.resize(books, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)


def seen(alpha, behind, seed=1):
    """Brown before the wall, with the noise of a camera."""
    colour = np.array([0.35, 0.22, 0.12])
    exact = alpha[..., None] * colour + (1 - alpha[..., None]) * behind
    noisy = exact + np.random.default_rng(seed).normal(0, 1 / 255, exact.shape)
    return np.rint(255 * noisy.clip(0, 1)).astype(np.uint8)


def coarse(alpha, seed=0):
    """What a network of a quarter of the resolution says: strands are missing, the outline is blurred and shifted."""
    small = cv2.resize(alpha, (SIDE // 4, SIDE // 4), interpolation=cv2.INTER_AREA)
    small = cv2.morphologyEx(small, cv2.MORPH_OPEN, np.ones((3, 3)))
    rng = np.random.default_rng(seed)
    return cv2.GaussianBlur(np.roll(small, rng.integers(-1, 2, 2), (0, 1)), (0, 0), 1.0).clip(0, 1)


def band(alpha, width=4):
    inside = (alpha > 0.5).astype(np.uint8)
    kernel = np.ones((2 * width + 1,) * 2, np.uint8)
    return cv2.dilate(inside, kernel) > cv2.erode(inside, kernel)


def error(found, alpha):
    return np.abs(found - alpha)[band(alpha)].mean()


def clip(count, busy, still=False):
    """Frames of a head that moves to and fro before a static camera, and their alphas."""
    alphas = [disc(64 if still else 64 + 24 * np.sin(i)) for i in range(count)]
    frames = [TimedFrame(i, i / 25, seen(alpha, wall(busy), seed=i)) for i, alpha in enumerate(alphas)]
    return frames, alphas


def test_the_band_lies_between_what_is_certain_and_grows_with_the_image():
    alpha = disc()
    regions = trimap(alpha)
    assert (alpha[regions == 255] > 0.99).all() and (alpha[regions == 0] < 0.01).all()
    shares = [(trimap(cv2.resize(alpha, (side, side))) == 128).mean() for side in (512, 1024, 2048)]
    assert shares == pytest.approx([shares[0]] * 3, rel=0.1)


def test_strands_that_a_coarse_matte_lacks_are_added_to_the_band():
    alpha = disc()
    bald = cv2.morphologyEx(alpha, cv2.MORPH_OPEN, np.ones((9, 9)))
    missed = (alpha > 0.5) & (trimap(bald) == 0)
    found = trimap(bald, distance=np.where(alpha > 0.3, 50.0, 0.0))
    assert missed.any() and (found[alpha > 0.5] > 0).all()
    assert not ((found == 128) & (trimap(bald) == 255)).any()


def test_alpha_of_a_smooth_scene_is_exact():
    alpha = disc()
    found = closed_form_alpha(seen(alpha, wall(busy=False)), trimap(alpha))
    assert error(found, alpha) < 0.01
    assert found.min() >= 0 and found.max() <= 1


def test_what_the_trimap_says_stays():
    rng = np.random.default_rng(0)
    regions = rng.choice(np.array([0, 128, 255], np.uint8), (24, 24))
    found = closed_form_alpha(rng.integers(0, 256, (24, 24, 3), np.uint8), regions)
    assert (found[regions == 0] == 0).all() and (found[regions == 255] == 1).all()


@pytest.mark.parametrize("value", [0, 255])
def test_frames_without_an_outline_have_a_constant_matte(value):
    image = seen(disc(), wall(busy=True))
    assert (closed_form_alpha(image, np.full((SIDE, SIDE), value, np.uint8)) == value / 255).all()


def test_a_prior_decides_where_the_image_says_nothing():
    grey = np.full((32, 32, 3), 128, np.uint8)
    regions = np.full((32, 32), 128, np.uint8)
    regions[:, 0], regions[:, -1] = 0, 255
    prior = np.tile(np.linspace(0, 1, 32) > 0.7, (32, 1)).astype(np.float32)
    assert np.abs(closed_form_alpha(grey, regions, prior, np.full((32, 32), 1e4)) - prior).max() < 0.1


def test_a_difference_matte_with_the_true_background_is_right_where_it_is_certain():
    alpha, behind = disc(), wall(busy=True)
    from carigs.matting.background import Background

    known = Background(behind.astype(np.float32), np.full((SIDE, SIDE), NOISE, np.float32))
    estimate, certainty = difference_prior(seen(alpha, behind), trimap(alpha), known)
    sure = (certainty > 100) & band(alpha)
    assert sure[band(alpha)].mean() > 0.6 and np.abs(estimate - alpha)[sure].mean() < 0.03
    unknown = trimap(alpha) == 128
    assert sure[unknown].mean() > 0.9 and np.abs(estimate - alpha)[sure & unknown].mean() < 0.005


def test_a_plain_wall_is_recognised_behind_the_head_and_books_are_not():
    found = plain_background(seen(disc(), wall(busy=False)))
    assert np.abs(found.colour - wall(busy=False))[: SIDE // 2].max() < 0.02
    assert plain_background(seen(disc(), wall(busy=True))) is None


def test_the_clean_plate_is_what_was_behind_the_head():
    frames, alphas = clip(24, busy=True)
    plate = clean_plate(
        (frame.image, cv2.blur(alpha, (9, 9)) == 0) for frame, alpha in zip(frames, alphas, strict=True)
    )
    known = plate.deviation < 0.02
    assert 0.85 < known.mean() < 1
    assert np.abs(plate.colour - wall(busy=True))[known].max() < 0.02
    assert (plate.deviation[np.min(alphas, axis=0) > 0.5] == UNKNOWN).all()  # the head never leaves it


def test_a_colour_that_too_few_frames_show_is_not_trusted():
    """Two colours of one pixel say nothing of how far the third one is off."""
    image = np.full((1, FEWEST_SEEN + 1, 3), 128, np.uint8)
    frames = [(image, np.arange(FEWEST_SEEN + 1)[None] > number) for number in range(FEWEST_SEEN)]
    deviation = clean_plate(frames).deviation[0]
    assert (deviation[:FEWEST_SEEN] == UNKNOWN).all() and deviation[FEWEST_SEEN] == pytest.approx(NOISE)


def test_a_background_that_moves_is_not_trusted():
    rng = np.random.default_rng(0)
    frames = ((rng.integers(0, 256, (16, 16, 3), np.uint8), np.ones((16, 16), bool)) for _ in range(20))
    assert clean_plate(frames).deviation.min() > 0.15


@pytest.mark.parametrize(("busy", "bar"), [(False, 0.04), (True, 0.08)])
def test_a_clip_with_coarse_mattes_has_small_errors_in_the_band(busy, bar):
    frames, alphas = clip(16, busy)
    found = list(matted_frames(frames, lambda frame: coarse(alphas[frame.number], frame.number)))
    assert [matted.frame.number for matted in found] == list(range(16))
    errors = [error(matted.alpha, alpha) for matted, alpha in zip(found, alphas, strict=True)]
    assert np.mean(errors) < bar


def test_the_known_background_makes_mattes_before_books_better():
    frames, alphas = clip(16, busy=True)
    plate = clean_plate((f.image, cv2.blur(alpha, (13, 13)) == 0) for f, alpha in zip(frames, alphas, strict=True))
    rough = cv2.resize(coarse(alphas[2], 2), (SIDE, SIDE))
    with_plate, without = (refined_alpha(frames[2].image, rough, known) for known in (plate, None))
    assert error(with_plate, alphas[2]) < 0.6 * error(without, alphas[2])


def test_a_person_before_a_plain_wall_needs_no_coarse_matte():
    frames, alphas = clip(3, busy=False)
    for matted, alpha in zip(matted_frames(frames), alphas, strict=True):
        assert error(matted.alpha, alpha) < 0.04
    with pytest.raises(CarigsError, match="frame 0: the background is not plain"):
        next(matted_frames(clip(1, busy=True)[0]))


def test_a_static_scene_does_not_flicker():
    frames, alphas = clip(10, busy=True, still=True)
    found = [matted.alpha for matted in matted_frames(frames, lambda frame: coarse(alphas[0], frame.number))]
    rough = [cv2.resize(coarse(alphas[0], i), (SIDE, SIDE)) for i in range(10)]
    flicker, before = (np.abs(np.diff(x[4:], axis=0))[:, band(alphas[0])].mean() for x in (found, rough))
    assert flicker < 0.02 < before


def test_a_head_that_moves_is_not_smeared():
    frames, alphas = clip(8, busy=False)
    steady, motion_to = SteadyMatte(0.5), ImageMotion()
    for frame, alpha in zip(frames, alphas, strict=True):
        assert error(steady(alpha, motion_to(frame.image)), alpha) < 0.03


def test_foreground_colours_before_the_same_wall_give_the_frame_back():
    alpha, behind = disc(), wall(busy=False)
    image = seen(alpha, behind)
    foreground = foreground_colours(image, alpha)
    opacity = alpha[..., None]
    assert np.abs(opacity * foreground + (1 - opacity) * behind - image / 255.0).mean() < 0.01
    edge = (alpha > 0.2) & (alpha < 0.8)
    halo, without = composite(image / 255.0, alpha, 1.0), composite(foreground, alpha, 1.0)
    truth = seen(alpha, np.ones(3))
    far, near = (np.abs(x[edge].astype(float) - truth[edge]).mean() for x in (halo, without))
    assert near < 0.35 * far


def test_the_largest_region_has_no_holes():
    region = np.zeros((20, 20), bool)
    region[4:14, 4:14], region[7:9, 7:9], region[16:18, 1:3] = True, False, True
    kept = largest_region(region)
    assert kept.sum() == 100 and kept[4:14, 4:14].all()
    assert not largest_region(np.zeros((5, 5), bool)).any()
