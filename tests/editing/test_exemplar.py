"""Frames in the style of one image, with tiny random weights in diffusers' own pipeline; and the provider of it."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from miniature import write_ball
from tiny_diffusion import write_diffusion_model, write_ip_adapter

from carigs.capture import Capture, read_dataset
from carigs.capture.images import read_rgb8, write_png
from carigs.editing.exemplar import load_exemplar_painter
from carigs.errors import InputError, SettingsError, WeightsMissing
from carigs.exaggeration import straight_path
from carigs.gtstar import by_exemplar
from carigs.head import neutral
from carigs.settings import Gtstar
from carigs.stages.gtstar import gtstar


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    write_diffusion_model(folder / "stable-diffusion-v1-5", sample_size=8)
    write_ip_adapter(folder / "ip-adapter", folder / "stable-diffusion-v1-5/unet")
    return folder


@pytest.fixture
def exemplars(tmp_path):
    """Two images of other sizes."""
    random = np.random.default_rng(0)
    files = [tmp_path / "first.png", tmp_path / "second.png"]
    for file, size in zip(files, ((50, 40), (30, 60)), strict=True):
        write_png(file, random.random((*size, 3)))
    return files


IMAGE = np.random.default_rng(1).random((60, 44, 3), dtype=np.float32)


@pytest.mark.slow
def test_an_image_depends_on_the_exemplar_the_strength_and_what_it_shows(weights, exemplars):
    paint = load_exemplar_painter(exemplars[0], 0.5, 1.0)
    image = paint(IMAGE)
    assert image.shape == IMAGE.shape and image.dtype == np.float32 and 0 <= image.min() < image.max() <= 1
    np.testing.assert_array_equal(paint(IMAGE), image)
    np.testing.assert_array_equal(load_exemplar_painter(exemplars[0], 0.5, 1.0)(IMAGE), image)
    assert (load_exemplar_painter(exemplars[1], 0.5, 1.0)(IMAGE) != image).any()
    assert (load_exemplar_painter(exemplars[0], 0.2, 1.0)(IMAGE) != image).any()
    assert (paint(1 - IMAGE) != image).any()


@pytest.mark.slow
@pytest.mark.parametrize("strength", [0.001, 1.0])
def test_every_strength_takes_a_step(weights, exemplars, strength):
    assert np.isfinite(load_exemplar_painter(exemplars[0], strength, 1.0)(IMAGE)).all()


def test_missing_weights_are_named_at_once(no_weights, exemplars):
    started = time.perf_counter()
    with pytest.raises(WeightsMissing, match=r"carigs weights fetch stable_diffusion_1\.5"):
        load_exemplar_painter(exemplars[0], 0.5, 1.0)
    assert time.perf_counter() - started < 1


@pytest.mark.slow
def test_files_that_cannot_be_used_are_refused_in_one_line(weights, exemplars, tmp_path):
    def problem(exemplar=exemplars[0]):
        with pytest.raises(InputError) as caught:
            load_exemplar_painter(exemplar, 0.5, 1.0)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    (tmp_path / "text.png").write_text("no image")
    assert "text.png" in problem(tmp_path / "text.png")
    from safetensors.torch import load_file, save_file

    file = weights / "ip-adapter/models/ip-adapter_sd15.safetensors"
    whole, state = file.read_bytes(), {name: value.clone() for name, value in load_file(file).items()}
    file.write_bytes(whole[:1000])
    assert "not a readable file of weights" in problem()
    save_file({name: value for name, value in state.items() if "to_k_ip" not in name}, file)
    assert "not a readable part of IP-Adapter" in problem()
    save_file({"other": state["image_proj.norm.bias"]}, file)
    assert "not a readable part of IP-Adapter" in problem()
    file.write_bytes(whole)
    encoder = weights / "ip-adapter/models/image_encoder/model.safetensors"
    encoder.write_bytes(encoder.read_bytes()[:500])
    assert "not a readable part" in problem()


@pytest.fixture
def ball(tmp_path) -> Path:
    write_ball(tmp_path / "ball")
    read_dataset(tmp_path / "ball", tmp_path / "ball/head_model.npz").save(tmp_path / "capture.json")
    subject = Capture.load(tmp_path / "capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    straight_path(shape, subject.model.faces, 0 * shape, 0.25).save(tmp_path / "path.npz")
    return tmp_path


def make_targets(ball: Path, **settings) -> dict:
    gtstar(
        Gtstar(**{"provider": "exemplar", "relight": "none", **settings}), capture=ball / "capture.json",
        path=ball / "path.npz", level=0.25, targets=ball / "targets", index=ball / "targets.json", resume_key="key",
    )  # fmt: skip
    return json.loads((ball / "targets.json").read_text())


@pytest.mark.filterwarnings("ignore::carigs.errors.CarigsWarning")
def test_targets_are_painted_once_and_a_killed_run_goes_on(ball, exemplars, monkeypatch, capsys):
    painted = []

    def load(exemplar, strength, background):
        def paint(image):
            if len(painted) == 2:
                painted.append(None)
                raise KeyboardInterrupt
            painted.append(image)
            return np.full_like(image, 0.4)

        return paint

    monkeypatch.setattr(by_exemplar, "load_exemplar_painter", load)
    with pytest.raises(KeyboardInterrupt):
        make_targets(ball, exemplar=str(exemplars[0]))
    index = make_targets(ball, exemplar=str(exemplars[0]))
    frames = Capture.load(ball / "capture.json").split("train")
    assert len(painted) == len(frames) + 1 and len(index["targets"]) == len(frames)
    assert f"2 of {len(frames)} frames were painted by an earlier run" in capsys.readouterr().out
    image = read_rgb8(ball / "targets" / index["targets"][0]["image"])
    assert (image == 102).all(axis=-1).sum() > 200


def test_a_provider_without_its_image_is_refused_before_work(ball):
    with pytest.raises(SettingsError, match=r"gtstar\.exemplar must be set when gtstar\.provider is exemplar"):
        make_targets(ball)
    with pytest.raises(SettingsError, match=r"gtstar\.exemplar=none\.png: gtstar\.provider=exemplar needs an image"):
        make_targets(ball, exemplar="none.png")
