"""Rigid motion from points in the images: exact without errors, the same with outliers, the gradient of its cost."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.tracking.texture.bundle_adjustment import BundleAdjustment, RigidMotion
from carigs.tracking.texture.corners import TextureTracks

FOCAL, CENTRE = 900.0, np.array([256.0, 250.0])


def recorded(outliers=0.0, frames=12, corners=40, length=8, seed=0):
    """A body that turns, its points in the images, and a guess that is off by some degrees."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.linspace([-0.2, -0.5, 0], [0.3, 0.5, 0.1], frames)).as_matrix()
    middle = np.linspace([-0.02, 0, 0.9], [0.03, 0.01, 0.95], frames)
    true = RigidMotion(turns, middle, 0.08 * rng.uniform(-1, 1, (corners, 3)))
    first = rng.integers(0, frames - length + 1, corners)
    frame = (first[:, None] + np.arange(length)).ravel()
    corner = np.repeat(np.arange(corners), length)
    seen = true.seen(TextureTracks(corner, frame, np.zeros((len(frame), 2)), np.zeros(corners, int)))
    pixels = FOCAL * seen[:, :2] / seen[:, 2:] + CENTRE
    wrong = rng.random(len(frame)) < outliers
    pixels[wrong] += rng.uniform(-30, 30, (wrong.sum(), 2))
    off = np.hstack([0.04 * rng.standard_normal((frames, 3)), 0.004 * rng.standard_normal((frames, 3))])
    guess = true.moved(off, 0.004 * rng.standard_normal((corners, 3)))
    tracks = TextureTracks(corner, frame, pixels, np.zeros(corners, int))
    return true, BundleAdjustment(tracks, FOCAL, CENTRE, guess)


def turns_between_frames(motion):
    return motion.rotation[1:] @ motion.rotation[:-1].swapaxes(1, 2)


@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_the_turns_between_frames_are_found_with_any_guess(outliers):
    true, adjustment = recorded(outliers)
    found = adjustment.solve()
    wrong = Rotation.from_matrix(turns_between_frames(found) @ turns_between_frames(true).swapaxes(1, 2)).magnitude()
    assert np.degrees(wrong).max() < 0.25
    assert np.median(np.linalg.norm(adjustment.errors(found), axis=1)) < 0.05


def test_the_gradient_is_that_of_finite_differences():
    _, adjustment = recorded(outliers=0.1, frames=9, corners=6)
    motion = adjustment.guess.moved(np.full((9, 6), 1e-3), np.full((6, 3), 1e-3))
    *_, of_frames, of_points = adjustment._equations(motion)
    for gradient, part in ((of_frames, 0), (of_points, 1)):
        for index in np.ndindex(gradient.shape):
            steps = [np.zeros_like(of_frames), np.zeros_like(of_points)]
            costs = []
            for sign in (1, -1):
                steps[part][index] = sign * 1e-6
                costs.append(adjustment.cost(motion.moved(*steps)))
            # The rotation of the prior is exact to first order in a small turn.
            assert (costs[0] - costs[1]) / 2e-6 == pytest.approx(
                gradient[index], rel=2e-3, abs=1e-2 * np.abs(gradient).max()
            )


def test_what_no_track_tells_stays_at_the_guess():
    _, adjustment = recorded()
    lonely = adjustment.tracks.frame.max()
    kept = adjustment.tracks.frame < lonely
    tracks = TextureTracks(
        adjustment.tracks.corner[kept], adjustment.tracks.frame[kept], adjustment.tracks.pixels[kept],
        adjustment.tracks.vertex,
    )  # fmt: skip
    found = BundleAdjustment(tracks, FOCAL, CENTRE, adjustment.guess).solve()
    np.testing.assert_allclose(found.rotation[lonely], adjustment.guess.rotation[lonely], atol=1e-9)
    np.testing.assert_allclose(found.middle[lonely], adjustment.guess.middle[lonely], atol=1e-12)
