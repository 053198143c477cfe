"""`carigs evaluate`: the card of a folder of renderings, from the truth and the settings of a study."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.frame_index import ground_truth_files, write_ground_truth
from carigs.capture.images import write_png
from carigs.cli.main import main
from carigs.exaggeration import straight_path
from carigs.head import neutral

SCHEMA = json.loads((Path(__file__).parents[2] / "docs/card.schema.json").read_text())
DIFFERENCE = 0.1
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """Results of a study of the ball as far as they are needed: capture, path and true images."""
    folder = tmp_path_factory.mktemp("work") / "results/mini"
    place = folder / "ball/gamma=0.25"
    place.mkdir(parents=True)
    dataset = write_ball(folder / "ball/dataset")
    read_dataset(dataset, dataset / "head_model.npz").save(folder / "ball/capture.json")
    subject = Capture.load(folder / "ball/capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    straight_path(shape, subject.model.faces, 0.2 * shape, 0.25).save(place / "path.npz")
    keys = [(frame.timestep, frame.camera) for frame in subject.split("test")]
    for level in (0, 0.25):
        truth = place / f"truth/level={level}"
        (truth / "frames").mkdir(parents=True)
        for frame in subject.split("test"):
            files = ground_truth_files(frame.timestep, frame.camera)
            write_png(truth / "frames" / files["image"], np.full((48, 40, 3), 0.4))
            write_png(truth / "frames" / files["mask"], subject.mask(frame))
        write_ground_truth(truth / "truth.json", level, keys)
    return folder


@pytest.fixture
def options(study, tmp_path, monkeypatch) -> list[str]:
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    return ["evaluate", "--results", str(study), "--subject", "ball"]


def views(options: list[str], folder: Path) -> list[dict]:
    assert main([*options, "--views", str(folder / "views.json")]) == 0
    return json.loads((folder / "views.json").read_text())


def render(entries: list[dict], folder: Path) -> Path:
    """Render what is asked for: images that are brighter than the truth by `DIFFERENCE` everywhere."""
    for entry in entries:
        file = folder / "mine" / entry["file"]
        file.parent.mkdir(parents=True, exist_ok=True)
        write_png(file, np.full((entry["view"]["height"], entry["view"]["width"], 3), 0.4 + DIFFERENCE))
    return folder / "mine"


def test_renderings_of_the_listed_views_get_a_card(options, tmp_path):
    entries = views(options, tmp_path)
    assert {(entry["protocol"], entry["level"]) for entry in entries} == {
        ("test", 0), ("val", 0), ("orbit", 0), ("test", 0.25), ("orbit", 0.25),
    }  # fmt: skip
    frames = render(entries, tmp_path)
    assert main([*options, "--frames", str(frames), "--name", "mine", "-o", str(tmp_path / "card")]) == 0
    card = json.loads((tmp_path / "card/card.json").read_text())
    jsonschema.validate(card, SCHEMA)
    values = {(v["measure"], v["protocol"], v["region"]): v for v in card["values"] if v["level"] in (0.25, None)}
    quantised = round(0.5 * 255) / 255 - round(0.4 * 255) / 255
    psnr = values["psnr", "test", "full"]
    assert psnr["value"] == pytest.approx(-20 * np.log10(quantised), abs=1e-3)
    assert psnr["n"] == sum((entry["protocol"], entry["level"]) == ("test", 0.25) for entry in entries)
    assert values["surfels", "avatar", ""]["value"] is None
    assert "another program" in values["surfels", "avatar", ""]["reason"]
    assert "mine" in (tmp_path / "card/card.md").read_text()


def test_a_wrong_folder_ends_the_command_before_it_measures(options, tmp_path, capsys):
    entries = views(options, tmp_path)
    frames = render(entries[1:], tmp_path)
    assert main([*options, "--frames", str(frames), "-o", str(tmp_path / "card")]) == 1
    error = capsys.readouterr().err
    assert f"1 missing ({entries[0]['file']})" in error
    assert not (tmp_path / "card").exists()


@pytest.mark.parametrize(
    ("more", "named"),
    [
        (["--name", "../x", "--views", "v.json"], "--name"),
        (["--gamma", "0.5", "--views", "v.json"], "no truth of any level"),
        ([], "--frames and --output"),
    ],
)
def test_what_cannot_be_is_said(options, more, named, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*options, *more]) == 1
    assert named in capsys.readouterr().err
