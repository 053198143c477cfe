"""What a run says of its settings when it starts."""

import pytest

from carigs.config import compose
from carigs.errors import SettingsError
from carigs.runs.settings_checks import check_study, settings_warnings


@pytest.fixture
def own(tmp_path):
    (tmp_path / "model.npz").touch()
    return ["study=own", f"capture.folder={tmp_path}", f"capture.head_model={tmp_path}/model.npz"]


def test_nothing_is_said_of_settings_that_are_followed(own):
    assert settings_warnings([]) == settings_warnings(own) == []


@pytest.mark.parametrize(
    ("given", "remedy"), [("video", "study=video"), ("folder", "study=own"), ("head_model", "study=own or study=video")]
)
def test_a_file_that_no_subject_reads_is_named_with_the_study_that_does(tmp_path, given, remedy):
    file = tmp_path / "mine"
    file.touch()
    (line,) = settings_warnings([f"capture.{given}={file}"])
    assert line == f"capture.{given}={file}: the study's toy does not read it; add {remedy}"


def test_a_file_that_one_of_the_subjects_reads_is_not_named(own):
    assert settings_warnings([*own, "study.subjects=[toy,own]"]) == []


@pytest.mark.parametrize(
    ("key", "value", "provider"),
    [("folder", "drawn", "precomputed"), ("command", "[python]", "command"), ("exemplar", "a.png", "exemplar")],
)
def test_an_input_of_targets_that_nothing_reads_is_named_with_the_provider_that_does(key, value, provider):
    few, given = "study.variants=[alternating]", f"gtstar.{key}={value}"
    assert settings_warnings([few, given]) == [f"gtstar.{key}: nothing reads it; add gtstar.provider={provider}"]
    assert not any(
        "nothing reads it" in line for line in settings_warnings([few, given, f"gtstar.provider={provider}"])
    )


def test_settings_of_edits_are_named_where_no_variant_edits():
    given = ["train.edit.regions=[nose]", "train.edit.steps=5"]
    lines = settings_warnings(["study.variants=[alternating]", *given])
    assert [line.partition(":")[0] for line in lines] == ["train.edit.regions", "train.edit.steps"]
    assert lines[0].endswith("no variant of the study edits frames; add train.edit.editor")
    assert settings_warnings(["study.variants=[alternating,drawn_nose]", *given]) == []


@pytest.mark.slow
def test_a_gamma_that_tears_and_a_dataset_that_is_nowhere_are_named(own):
    (line,) = settings_warnings(["gamma=1.5"])
    assert line.startswith("gamma=1.5: outside [-1, 1] the surface is torn")
    (line,) = settings_warnings(["exaggerate.regions={nose:-2,ears:0.4}"])
    assert line.startswith("exaggerate.regions.nose=-2: outside [-1, 1] the surface is torn")
    (line,) = settings_warnings([*own, "capture.folder=/nowhere/anna"])
    assert line == "capture.folder: there is no /nowhere/anna; own cannot be made"


def test_every_file_that_is_nowhere_is_named_once(own):
    sculpt = ["exaggerate.file='/nowhere/{gamma}.obj'"]
    lines = settings_warnings([*own, *sculpt, "capture.head_model=none.npz", "train.start=a.npz"])
    assert lines == [
        f"{key}: there is no {path}; own cannot be made"
        for key, path in {
            "capture.head_model": "none.npz", "exaggerate.file": "/nowhere/0.25.obj", "train.start": "a.npz"
        }.items()
    ]  # fmt: skip


def test_levels_above_gamma_are_named():
    (line,) = settings_warnings(["study.levels=[0,0.5,0.25]"])
    assert line == "study.levels: 0.5 left out; gamma=0.25 is the highest level"


def test_a_truth_that_is_nowhere_is_named_and_one_level_is_enough(own, tmp_path):
    truth = f"truth.folder={tmp_path}/level={{level}}"
    (line,) = settings_warnings([*own, truth.replace("=/", "='/") + "'"])
    assert line.startswith(f"truth.folder: no folder {tmp_path}/level=0.25; own is compared with no true caricature")
    (tmp_path / "level=0.125").mkdir()
    assert settings_warnings([*own, truth.replace("=/", "='/") + "'"]) == []


@pytest.mark.slow
def test_settings_that_follow_gamma_cannot_be_shared_by_several_gammas(tmp_path, monkeypatch):
    """Only the paths of `exaggerate` tell gammas apart."""
    (tmp_path / "conf/study").mkdir(parents=True)
    (tmp_path / "conf/study/tied.yaml").write_text("# @package _global_\ntrain:\n  initial_scale: ${gamma}\n")
    monkeypatch.chdir(tmp_path)
    compose.cache_clear()
    gammas = [["study=tied", f"gamma={gamma}"] for gamma in (0.1, 0.2)]
    with pytest.raises(SettingsError, match="settings of train depend on it"):
        check_study(gammas)
    check_study(gammas[:1])
    check_study([[*overrides, "train.initial_scale=0.3"] for overrides in gammas])
    compose.cache_clear()


def test_a_folder_of_weights_that_is_nowhere_is_named(tmp_path):
    (line,) = settings_warnings(["metrics.weights=/nowhere/wieghts"])
    assert line == "metrics.weights: there is no folder /nowhere/wieghts; weights are searched for in the other places"
    assert settings_warnings([f"metrics.weights={tmp_path}"]) == []
