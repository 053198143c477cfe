"""The early end of a training: what counts as a plateau, the learning rates after it, and whole runs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.errors import InputError
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import neutral
from carigs.settings import Density, Plateau, Train
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training import plateau, trainer
from carigs.splat.training.checkpoint import Checkpoint
from carigs.splat.training.plateau import Ending, ending_after, has_levelled_off, measures_after, validation_frames
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import learning_rates, train_surfels

SETTINGS = Train(
    iterations=200,
    gtstar_probability=0.0,
    hair_layers=2,
    density=Density(every=0),
    plateau=Plateau(every=5),
)


@pytest.fixture
def few(monkeypatch):
    """A row of the log for each five steps, and two held-out frames.

    Every gain is too small: a training ends as soon as two quarters can be compared.
    """
    monkeypatch.setattr(trainer, "LOG_EVERY", 5)
    monkeypatch.setattr(plateau, "MIN_GAIN", 1000.0)
    monkeypatch.setattr(plateau, "FRAMES", 2)


def measured(psnr, last, every):
    return [(step, float(psnr(step))) for step in range(every, last + 1, every)]


@given(slope=st.floats(0.01, 10), noise=st.floats(0, 0.2), every=st.integers(1, 50), seed=st.integers(0, 99))
def test_growth_with_the_logarithm_of_the_steps_is_compared_with_the_gain_of_a_quarter(slope, noise, every, seed):
    """Means of a ln(n) over the last two quarters differ by 0.339 a, whatever their number."""
    rng = np.random.default_rng(seed)
    history = measured(lambda n: slope * np.log(n) + noise * rng.uniform(-1, 1), 4000, every)
    gain = slope * (4 * np.log(4) - 6 * np.log(3) + 2 * np.log(2))  # of the two means
    assert gain == pytest.approx(0.339 * slope, rel=1e-2)
    margin = 2 * noise + 0.02 * slope
    assert not has_levelled_off(history, gain - margin)
    assert has_levelled_off(history, gain + margin)


def test_a_constant_quality_has_levelled_off_and_a_falling_one_too():
    assert has_levelled_off(measured(lambda n: 30, 80, 10), 0.01)
    assert has_levelled_off(measured(lambda n: 30 - n, 80, 10), 0.0)


@pytest.mark.parametrize("last", [10, 20, 30, 40, 50, 60])
def test_quarters_with_less_than_two_measurements_say_nothing(last):
    assert not has_levelled_off(measured(lambda n: 30, last, 10), 1.0)
    assert not has_levelled_off([], 1.0)


@given(iterations=st.integers(2, 10_000), share=st.floats(0.05, 0.95))
def test_learning_rates_have_no_jump_and_end_at_their_last_value(iterations, share):
    settings = Train(iterations=iterations, plateau=Plateau(every=1))
    done = max(1, int(share * iterations))
    if not measures_after(settings, done) or done + 1 >= iterations:
        return
    ending = Ending(done, min(done + max(1, int(np.ceil(plateau.COOLDOWN * done))), iterations))
    progress = np.array([ending.progress(i, iterations) for i in range(ending.last)])
    np.testing.assert_allclose(progress[:done], np.arange(done) / (iterations - 1))
    np.testing.assert_allclose(np.diff(progress[done - 1 :], 2), 0, atol=1e-12)  # linear
    assert (np.diff(progress) > 0).all() and progress[-1] == pytest.approx(1)
    last = learning_rates(settings, progress[-1])
    assert last["opacity"] == pytest.approx(trainer.OPACITY_LR * settings.final_lr_factor)


def test_a_training_is_measured_after_density_control_while_an_end_would_shorten_it():
    settings = Train(iterations=1000, density=Density(stop=300), plateau=Plateau(every=50))
    steps = [done for done in range(1, 1001) if measures_after(settings, done)]
    assert steps == list(range(300, 800, 50))
    assert not any(measures_after(replace(settings, plateau=Plateau(every=0)), done) for done in range(1, 1001))
    history = measured(lambda n: 30, 600, 50)
    assert ending_after(settings, history) == (600, 750)
    assert ending_after(settings, measured(lambda n: n, 600, 50)) == (None, 1000)


@pytest.fixture
def subject(few, ball):
    return ball


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    write_ball(folder)
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    return capture, head_sequence(capture, straight_path(rest, capture.model.faces, rest * [0.3, 0, 0], 0.25))


def run(subject, checkpoint, settings=SETTINGS, on_step=None, **changes):
    training = TrainingSubject(subject[1], Supervision(subject[0]))
    surfels, rows = train_surfels(replace(settings, **changes), training, Checkpoint(checkpoint, "key"), on_step)
    return b"".join(value.tobytes() for value in to_arrays(surfels).values()), [(r[0], *r[2:]) for r in rows]


def test_a_training_that_gains_too_little_ends_early_with_low_rates(subject, tmp_path, capsys):
    """35 steps are the first with two measurements in both quarters; nine more are a quarter of them."""
    _, rows = run(subject, tmp_path / "c")
    assert rows[-1][0] == 44
    assert [row[0] for row in rows if row[5] is not None] == [5, 10, 15, 20, 25, 30, 35]
    assert "train 44/44" in capsys.readouterr().err


def test_the_logged_quality_is_that_of_the_held_out_frames(subject, tmp_path):
    """The mean PSNR of the frames that the surfels of that step render."""
    from carigs.splat.avatar import Avatar

    capture, sequence = subject
    found = {}

    def look(state):
        if state.iteration == 10:
            avatar = Avatar(state.surfels, sequence, background=capture.background)
            found[10] = [
                -10 * np.log10(np.mean((avatar.render(f.timestep, 0.0, capture.camera(f)) - capture.image(f)) ** 2))
                for f in validation_frames(capture)
            ]

    _, rows = run(subject, tmp_path / "c", on_step=look)
    assert {row[0]: row[5] for row in rows}[10] == pytest.approx(np.mean(found[10]), abs=1e-3)


@pytest.mark.parametrize("stop", [12, 36, 41])
def test_a_killed_run_that_ends_early_resumes_to_the_same_bytes(subject, tmp_path, monkeypatch, stop):
    def kill(state):
        if state.iteration == stop:
            raise KeyboardInterrupt

    whole = run(subject, tmp_path / "whole")
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        run(subject, tmp_path / "c", on_step=kill)
    assert run(subject, tmp_path / "c") == whole


def test_measuring_alone_changes_no_surfel(subject, tmp_path, monkeypatch):
    """With gains that count, the bytes are those of a training that measures nothing."""
    monkeypatch.setattr(plateau, "MIN_GAIN", 0.0)
    first, rows = run(subject, tmp_path / "a", iterations=30)
    second, others = run(subject, tmp_path / "b", iterations=30, plateau=Plateau(every=0))
    assert first == second
    assert [row[:5] for row in rows] == [row[:5] for row in others]
    assert any(row[5] is not None for row in rows) and not any(row[5] is not None for row in others)


def test_without_held_out_frames_a_training_does_all_its_steps(subject, tmp_path, monkeypatch):
    monkeypatch.setattr("carigs.splat.training.trainer.validation_frames", lambda capture: [])
    assert run(subject, tmp_path / "c", iterations=60)[1][-1][0] == 60


def test_a_held_out_frame_that_cannot_be_read_is_named(subject, tmp_path, monkeypatch):
    capture = subject[0]
    broken = replace(validation_frames(capture)[0], image="none.png")
    monkeypatch.setattr("carigs.splat.training.trainer.validation_frames", lambda *_: [broken])
    with pytest.raises(InputError, match=r"none\.png"):
        run(subject, tmp_path / "c")


def test_held_out_frames_are_spread_over_all(subject, monkeypatch):
    capture = subject[0]
    frames = list(capture.split("val"))
    monkeypatch.setattr(plateau, "FRAMES", 1000)
    assert frames and validation_frames(capture) == frames
    monkeypatch.setattr(plateau, "FRAMES", 1)
    assert validation_frames(capture) == frames[:1]
