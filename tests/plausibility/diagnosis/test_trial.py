"""The diagnosis names the mistake that was planted, and none where nothing is wrong."""

from pathlib import Path

import pytest
from miniature import bust_cameras, bust_model, write_ball
from planted_mistakes import MISTAKES, SOUND, copy_dataset
from shared_data import DATA, needs_data

from carigs.capture import read_dataset
from carigs.plausibility.diagnosis import Diagnosis, diagnose, read_scene
from carigs.plausibility.diagnosis.scene import TIMESTEPS
from carigs.plausibility.diagnosis.trial import MENDED
from carigs.settings import Toy
from carigs.toy import write_capture

SMALL = Toy(width=72, height=96, cameras=5, steps_per_sequence=1, supersampling=1, texture_size=256, hair_strands=400)


def fewer_timesteps(name: str) -> int:
    """Of captures with 16 cameras: half the evidence that users' captures give, but for shifts in time."""
    return TIMESTEPS if name in ("late parameters", "early parameters") else 2


@pytest.fixture(scope="module")
def bust(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bust")
    return write_ball(folder, 6, bust_model(), bust_cameras(), step=(0.006, -0.003, 0.004))


@pytest.fixture(scope="module")
def toy(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("toy")
    write_capture(folder, SMALL)
    return folder


def diagnosis(folder: Path, model: Path, timesteps: int) -> Diagnosis:
    return diagnose(read_scene(read_dataset(folder, model, errors=[]), timesteps=timesteps))


def check_mistake(source: Path, model: Path, folder: Path, name: str, timesteps: int = TIMESTEPS) -> None:
    damage, says = MISTAKES[name]
    copy_dataset(source, folder, range(6))
    damage(folder)
    found = diagnosis(folder, model, timesteps)
    assert found.problem.startswith(says)
    assert len(found.mistakes) == 1 + (name == "OpenCV axes in millimetres")
    assert found.mended.outside_share < MENDED


def check_sound(source: Path, model: Path, folder: Path, name: str, timesteps: int = TIMESTEPS) -> None:
    copy_dataset(source, folder, range(6))
    SOUND[name](folder)
    assert diagnosis(folder, model, timesteps).mistakes == ()


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", MISTAKES)
def test_a_planted_mistake_is_named(bust, tmp_path, name):
    check_mistake(bust, bust / "head_model.npz", tmp_path / "planted", name)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_named_where_nothing_is_wrong(bust, tmp_path, name):
    check_sound(bust, bust / "head_model.npz", tmp_path / "sound", name)


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_planted_into_the_toy_is_named(toy, tmp_path, name):
    check_mistake(toy, toy / "head_model.npz", tmp_path / "planted", name)


@pytest.mark.slow
@pytest.mark.parametrize("name", SOUND)
def test_the_toy_raises_no_false_alarm(toy, tmp_path, name):
    check_sound(toy, toy / "head_model.npz", tmp_path / "sound", name)


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("subject", ["ict_s1", "ict_s7"])
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_planted_into_path_traced_images_is_named(tmp_path, subject, name):
    check_mistake(DATA / subject, DATA / "ict_model.npz", tmp_path / "planted", name, fewer_timesteps(name))


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("subject", ["ict_s1", "ict_s7"])
@pytest.mark.parametrize("name", SOUND)
def test_path_traced_images_raise_no_false_alarm(tmp_path, subject, name):
    check_sound(DATA / subject, DATA / "ict_model.npz", tmp_path / "sound", name, fewer_timesteps(name))
