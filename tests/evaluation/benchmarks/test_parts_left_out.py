"""The benchmark of parts: each training lacks what it says and nothing else, on a small toy with long hair."""

from dataclasses import replace

import pytest

from carigs.settings import Density, Exaggerate, Gtstar, Hair, Toy, Train
from evaluation.benchmarks.measurement.study_subject import StudySubject
from evaluation.benchmarks.measurement.toy_training import make_inputs
from evaluation.benchmarks.parts_left_out import PARTS, prepare_without

pytestmark = pytest.mark.slow
SMALL = Toy(
    width=52,
    height=68,
    cameras=4,
    steps_per_sequence=1,
    supersampling=1,
    texture_size=128,
    hair="long",
    hair_strands=2000,
)
SETTINGS = Train(iterations=2, density=Density(every=0))


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder, gtstar = tmp_path_factory.mktemp("toy"), Gtstar()
    inputs = make_inputs(folder, SMALL, Exaggerate(), gtstar)
    study = StudySubject(folder, inputs.capture, inputs.path, inputs.hair, SETTINGS, gtstar, Hair())
    unshaded = folder / "unshaded"
    unshaded.mkdir()
    without = study.targets_without_shadow(unshaded)
    sets = {part: without if part == "shadow of the hair" else inputs.targets for part in PARTS}
    return {part: prepare_without(part, study, SETTINGS, sets[part]) for part in PARTS}


def present(settings, subject):
    """What a training has, by part."""
    return {
        "surfels inside the hair": subject.hair is not None,
        "smooth motion of the scalp": subject.sequence.smooth is not None,
        "opaque hidden skin": subject.hair is not None and bool(subject.hair.hidden.any()),
        "flag covered": "covered" in settings.mask_flags,
        "shadow of the hair": subject.sequence.hair_shadow is not None,
        "brows that keep their size": bool(subject.sequence.rig.keeps_size.any()) and "brows" in settings.mask_flags,
        "surfels inside the mouth": subject.mouth is not None,
    }


@pytest.mark.parametrize("part", PARTS)
def test_a_training_lacks_the_part_alone(prepared, part):
    lacking = {name for name, there in present(*prepared[part]).items() if not there}
    inside = {"surfels inside the hair", "smooth motion of the scalp", "opaque hidden skin"}
    assert lacking == (inside if part == "surfels inside the hair" else {part} - {"nothing"})


@pytest.mark.parametrize("part", PARTS)
def test_settings_are_those_of_the_study_otherwise(prepared, part):
    settings, _ = prepared[part]
    changed = ("hair_layers", "mouth_surfels", "mask_flags")
    assert replace(settings, **{name: getattr(SETTINGS, name) for name in changed}) == SETTINGS
