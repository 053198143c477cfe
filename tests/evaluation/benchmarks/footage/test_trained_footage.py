"""What trainings on footage read and are compared with: the true dataset, true images, settings of the study."""

from dataclasses import replace

import numpy as np
import pytest

from carigs.capture import read_dataset
from carigs.exaggeration import Caricature
from carigs.head import neutral
from carigs.matting.mattes import given_mattes
from carigs.matting.neck_cut import NeckCut
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT
from evaluation.benchmarks.footage.oracle_recordings import filmed_toy, oracle_recordings, toy_subject
from evaluation.benchmarks.footage.trained_footage import (
    MADE,
    REGIONS,
    TRACKED,
    TRUE,
    measure,
    study_settings,
    true_views,
    write_true_dataset,
)

SMALL = {"supersampling": 1, "texture_size": 128, "hair_strands": 100}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A small person, the footage, where it is cut, and its true dataset."""
    subject = toy_subject(**SMALL)
    filmed = filmed_toy(subject, "talk", Talk(seconds=1, fps=12), side=64)
    [recording] = oracle_recordings(filmed, EXACT)
    matted = [*given_mattes(recording.footage, lambda frame: filmed.mattes[0][frame.number] / 255)]
    model, folder = filmed.truth.model, tmp_path_factory.mktemp("true") / "dataset"
    rest = neutral(model, filmed.truth.parameters[0])
    cut = NeckCut(rest, model.faces, float(rest[model.vertex_region("lips"), 1].min()) - 0.03)
    write_true_dataset(folder, filmed, matted, cut)
    return subject, filmed, cut, read_dataset(folder, folder / "head_model.npz", background=1.0)


def test_the_true_dataset_has_the_true_heads_and_camera(written):
    _, filmed, _, capture = written
    truth = filmed.truth
    assert len(capture.frames) == len(truth.parameters)
    for frame in capture.frames:
        found, true = capture.parameters(frame.timestep), truth.parameters[frame.timestep]
        for name in ("translation", "rotation", "joints", "expression", "shape"):
            np.testing.assert_allclose(getattr(found, name), getattr(true, name), atol=1e-6)
        camera = capture.camera(frame)
        np.testing.assert_allclose(camera.camera_from_world, truth.cameras[0][0].camera_from_world, atol=1e-6)
        np.testing.assert_allclose(camera.intrinsics, truth.cameras[0][0].intrinsics, rtol=1e-6)


def test_true_images_are_what_the_true_dataset_shows(written):
    """But for the noise of the camera and for pixels of the outline, whose colours are estimated."""
    subject, filmed, cut, capture = written
    still = Caricature(np.zeros(filmed.truth.model.v_template.shape))
    frames = capture.frames[::5]
    for frame, view in zip(frames, true_views(subject, filmed, cut, frames, still), strict=True):
        inside = view.regions["person"] & (capture.foreground(frame) > 0.99)
        assert inside.mean() > 0.1 and set(REGIONS) <= view.regions.keys()
        assert np.abs(view.truth - capture.image(frame))[inside].mean() < 0.02
        assert not view.regions["hair"][-1].any()  # below the cut


def test_settings_are_those_of_the_study(tmp_path):
    train = study_settings("train", tmp_path)
    assert (train.iterations, train.density.stop, train.sh_degree, train.cover_unseen) == (1500, 750, 2, "all")
    assert train.gtstar_probability > 0


@pytest.mark.slow
def test_tracking_costs_more_than_it_gains(tmp_path):
    subject = toy_subject(**SMALL)
    filmed = filmed_toy(subject, "talk", Talk(seconds=2, fps=12.5), side=96)
    train, gtstar = (study_settings(name, tmp_path) for name in ("train", "gtstar"))
    train = replace(train, iterations=30, density=replace(train.density, stop=15))
    mattes = {
        frame.tobytes(): np.float32(matte) / 255
        for frame, matte in zip(filmed.frames[0], filmed.mattes[0], strict=True)
    }
    rows = measure(tmp_path, filmed, subject, lambda image: mattes[image.tobytes()], train, gtstar)
    values = {(row.case, row.quantity): row.value for row in rows}
    for level in ("0", "0.25"):
        true, made, tracked = (values[f"{name}, level {level}", "PSNR of person"] for name in (TRUE, MADE, TRACKED))
        assert true > 15 and abs(made - true) < 1 and tracked < true
