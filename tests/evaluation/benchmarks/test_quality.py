"""The benchmark of quality against time: longer trainings come closer to the held-out views, at both levels."""

from types import SimpleNamespace

import pandas as pd
import pytest

from carigs.settings import Density, Exaggerate, Gtstar, Hair, Toy, Train
from evaluation.benchmarks.measurement.plots import plot_quality
from evaluation.benchmarks.measurement.study_subject import StudySubject
from evaluation.benchmarks.measurement.toy_training import held_out_views, make_inputs
from evaluation.benchmarks.quality import SHARES, measure

pytestmark = pytest.mark.slow
SMALL = Toy(width=52, height=68, cameras=4, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=2000)
SETTINGS = Train(iterations=96, density=Density(every=0), gtstar_probability=0.35, relight_surfels=True)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A subject of a study, of which the index of the capture alone lies where the benchmark looks for it."""
    inputs = make_inputs(tmp_path, SMALL, Exaggerate(), Gtstar())
    study = StudySubject(tmp_path, inputs.capture, inputs.path, inputs.hair, SETTINGS, Gtstar(), Hair())
    monkeypatch.setattr(StudySubject, "load", lambda _folder, _variant: study)
    monkeypatch.setattr(StudySubject, "targets", lambda _: inputs.targets)
    monkeypatch.setattr(StudySubject, "views", lambda _, level: held_out_views(inputs, level))
    return tmp_path / "gamma=0.25"


def test_longer_trainings_come_closer(folder, tmp_path):
    measurements = list(measure(folder))
    table = pd.DataFrame(measurements).pivot(index="case", columns="quantity", values="value")
    trainings = table.dropna(subset="CPU time")
    steps = trainings.index.str.extract(r"(\d+) steps", expand=False).astype(int)
    assert set(steps) == {SETTINGS.iterations * share for share in SHARES}
    trainings = trainings.set_index(steps).sort_index()
    assert (trainings["CPU time"] > 0).all()  # their order is a matter of the machine's load
    for level in ("0", "0.25"):
        psnr = trainings[f"PSNR at level {level}, full"]
        assert psnr.iloc[-1] > psnr.iloc[0] + 1
    assert table["CPU time of the stage hair"].count() == 1
    plot_quality(tmp_path / "quality.png", measurements)
    assert (tmp_path / "quality.png").stat().st_size > 1000


def test_settings_of_another_length_are_those_of_the_study_otherwise():
    density = Density(stop=64)
    study = SimpleNamespace(train=Train(iterations=96, density=density, seed=3))
    assert StudySubject.settings_for(study, 96) == Train(iterations=96, density=density, seed=3)
    assert StudySubject.settings_for(study, 12).density.stop == 8
