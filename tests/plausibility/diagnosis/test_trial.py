"""The diagnosis names the mistake that was planted, and none where nothing is wrong."""

from pathlib import Path

import pytest
from planted_mistakes import MISTAKES, SOUND, copy_dataset
from shared_data import DATA, needs_data

from carigs.capture import read_dataset
from carigs.plausibility.diagnosis import Diagnosis, diagnose, read_scene
from carigs.settings import Toy
from carigs.toy import write_capture

SMALL = Toy(width=72, height=96, cameras=5, steps_per_sequence=1, supersampling=1, texture_size=256, hair_strands=400)
QUICK = ("both in millimetres", "OpenCV axes", "negative fl_y", "flipped cy", "late parameters", "exchanged cameras")


@pytest.fixture(scope="module")
def toy(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("toy")
    write_capture(folder, SMALL)
    return folder


def diagnosis(folder: Path, model: Path) -> Diagnosis:
    return diagnose(read_scene(read_dataset(folder, model, errors=[])))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in MISTAKES]
)
def test_a_planted_mistake_is_named(toy, tmp_path, name):
    damage, says = MISTAKES[name]
    folder = copy_dataset(toy, tmp_path / "planted", range(6))
    damage(folder)
    found = diagnosis(folder, toy / "head_model.npz")
    assert found.problem.startswith(says)
    assert len(found.mistakes) == 1 + (name == "OpenCV axes in millimetres")
    assert found.mended.silhouette < 0.05


@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_named_where_nothing_is_wrong(toy, tmp_path, name):
    folder = copy_dataset(toy, tmp_path / "sound", range(6))
    SOUND[name](folder)
    assert diagnosis(folder, toy / "head_model.npz").mistakes == ()


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("subject", ["ict_s1", "ict_s7"])
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_planted_into_path_traced_images_is_named(tmp_path, subject, name):
    damage, says = MISTAKES[name]
    folder = copy_dataset(DATA / subject, tmp_path / "planted", range(6))
    damage(folder)
    assert diagnosis(folder, DATA / "ict_model.npz").problem.startswith(says)


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("subject", ["ict_s1", "ict_s7"])
@pytest.mark.parametrize("name", SOUND)
def test_path_traced_images_raise_no_false_alarm(tmp_path, subject, name):
    folder = copy_dataset(DATA / subject, tmp_path / "sound", range(6))
    SOUND[name](folder)
    assert diagnosis(folder, DATA / "ict_model.npz").mistakes == ()
