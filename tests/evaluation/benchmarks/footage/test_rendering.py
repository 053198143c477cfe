"""Frames before backgrounds are what their mattes say, and frames of a dataset show the head that the truth poses."""

import numpy as np
import pytest
from shared_data import DATA, needs_data

from carigs.capture import read_dataset
from carigs.footage import read_footage
from carigs.head import pose
from carigs.raster import compute_visibility
from carigs.settings import Toy
from carigs.toy import head_model, make_subject
from evaluation.benchmarks.footage import __main__ as command
from evaluation.benchmarks.footage.backgrounds import KINDS, background
from evaluation.benchmarks.footage.dataset_views import azimuth, dataset_footage, dataset_person
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.rendering import NOISE, before, person
from evaluation.benchmarks.footage.scenes import talk
from evaluation.benchmarks.footage.truth import FootageTruth


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_opaque_hides_the_background_and_the_rest_shows_it(kind):
    rng = np.random.default_rng(0)
    behind = background(kind, 60, 80, 40, rng)
    colours, alpha = rng.uniform(0, 1, (60, 80, 3)), np.zeros((60, 80))
    alpha[20:40, 20:50] = 1
    alpha[50:, :] = 0.5
    over_white = alpha[..., None] * colours + 1 - alpha[..., None]
    frames = list(before([(over_white, alpha)] * 40, behind))
    # The noise averages out over the frames, as `moving` moves in the background alone.
    mean = np.mean([frame for frame, _ in frames], axis=0) / 255
    expected = alpha[..., None] * colours + (1 - alpha[..., None]) * np.mean(behind, axis=0)
    inside = (expected > 0.05) & (expected < 0.95)  # noise is cut off at black and white
    assert np.abs(mean - expected)[inside].max() < 6 * NOISE / 255 / np.sqrt(40) + 0.001
    assert (frames[0][1] == np.rint(255 * alpha)).all()
    assert (np.ptp(behind, axis=0).max() > 0.1) == (kind == "moving")


def overlap(mesh: np.ndarray, matte: np.ndarray) -> float:
    return (mesh & matte).sum() / (mesh | matte).sum()


@pytest.mark.slow
def test_the_command_writes_a_video_and_its_truth(tmp_path, monkeypatch):
    small = make_subject(Toy(seed=2, supersampling=1, texture_size=128, hair_strands=200))
    monkeypatch.setattr(command, "make_subject", lambda settings: small)
    monkeypatch.setattr("sys.argv", ["footage", str(tmp_path), "--side", "128", "--seconds", "0.4"])
    command.main()
    footage, truth = read_footage(tmp_path / "0.mp4"), FootageTruth.load(tmp_path)
    assert len(footage) == len(truth.parameters) == 10 and footage.fps == pytest.approx(25)
    frames = [frame.image.astype(float) for frame in footage]
    mine = talk(head_model(), small.shape, 128, Talk(0.4, seed=2))
    np.testing.assert_allclose(truth.vertices(), mine.vertices(), atol=1e-9)
    rendered = list(before(person(small, mine), background("plain", 128, 128, 10, np.random.default_rng(0))))
    assert np.mean([np.abs(a - b[0]).mean() for a, b in zip(frames, rendered, strict=True)]) < 4  # of 255


@needs_data
@pytest.mark.parametrize(("kind", "timesteps", "cameras"), [("talk", 30, 1), ("orbit", 16, 1), ("three", 30, 3)])
def test_frames_of_a_dataset_show_the_head_of_the_truth(kind, timesteps, cameras):
    capture = read_dataset(DATA / "ict_s1", DATA / "ict_model.npz")
    truth, frames = dataset_footage(capture, kind)
    assert len(truth.parameters) == len(frames) == timesteps and len(frames[0]) == cameras
    last = cameras - 1
    for t, (_, alpha) in zip((0, 1, 2), dataset_person(capture, frames, last), strict=False):
        mesh = (
            compute_visibility(pose(truth.model, truth.parameters[t]), truth.model.faces, truth.cameras[t][last]).face
            >= 0
        )
        assert overlap(mesh, alpha > 0.5) > 0.85
    if kind == "orbit":
        azimuths = [azimuth(seen[0]) for seen in truth.cameras]
        assert (np.diff(azimuths) >= 0).all() and np.ptp(azimuths) > 60
        assert len({p.expression.tobytes() for p in truth.parameters}) == 1
