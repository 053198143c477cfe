"""Refinement of the tracked head: its pose in PyTorch, the gradient, and what training makes of it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from heads import gnm_file, gnm_like
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import HeadModel, HeadParameters, neutral, pose, subject_model
from carigs.settings import Density, RefineTracking, Train
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training import trainer
from carigs.splat.training.checkpoint import Checkpoint
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.tracking_refinement import DifferentiableHead, RefinedParameters, TrackingRefinement
from carigs.splat.training.trainer import train_surfels

SETTINGS = Train(
    iterations=40, gtstar_probability=0.0, hair_layers=0, density=Density(every=0),
    refine_tracking=RefineTracking(until=0.5, translation_lr=2e-4),
)  # fmt: skip


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    write_ball(folder)
    return read_dataset(folder, folder / "head_model.npz")


@pytest.fixture
def sequence(capture):
    rest = neutral(capture.model, capture.parameters(0))
    return head_sequence(capture, straight_path(rest, capture.model.faces, rest * [0.3, 0, 0], 0.25))


def random_parameters(seed: int) -> HeadParameters:
    rng = np.random.default_rng(seed)
    translation, rotation, *joints = 0.3 * rng.normal(size=(6, 3))
    return HeadParameters(translation, rotation, np.array(joints), expression=rng.normal(size=100))


def full_model(model):
    """The ball with expressions, correctives and joints that all move something."""
    rng, v = np.random.default_rng(0), len(model.v_template)
    shapedirs = np.zeros((v, 3, 400), np.float32)
    shapedirs[:, :, 300 + np.array([0, 3, 7])] = 0.003 * rng.normal(size=(v, 3, 3))
    weights = rng.random((v, 5))
    return replace(
        model, shapedirs=shapedirs, posedirs=(1e-3 * rng.normal(size=(v, 3, 36))).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
    )  # fmt: skip


def without_correctives(model):
    return replace(model, posedirs=model.posedirs[:, :, :0])


@pytest.mark.parametrize(("change", "seed"), [(full_model, 0), (full_model, 1), (without_correctives, 0)])
def test_the_differentiable_head_poses_as_the_head_model(capture, change, seed):
    model, parameters = change(capture.model), random_parameters(seed)
    head = DifferentiableHead(model)
    if change is full_model:
        np.testing.assert_array_equal(head.used, [0, 3, 7])
    posed = head.pose(RefinedParameters(parameters, head.used)).detach().numpy()
    np.testing.assert_allclose(posed, pose(model, parameters), atol=1e-6)  # refined parameters are float32


def test_other_heads_and_offsets_of_a_frame_are_posed_as_well(tmp_path):
    """GNM: four joints, its own joints, correctives of all of them, and VHAP's offset of one frame."""
    general, random = HeadModel.load(gnm_file(tmp_path, gnm_like(0))), np.random.default_rng(1)
    zeros = HeadParameters.zeros(general)
    model = subject_model(general, replace(zeros, shape=random.normal(size=zeros.shape.shape)))
    offset = random.normal(size=model.v_template.shape)
    parameters = replace(
        zeros, rotation=random.normal(size=3), joints=random.normal(size=zeros.joints.shape),
        expression=random.normal(size=zeros.expression.shape), dynamic_offset=offset,
    )  # fmt: skip
    head = DifferentiableHead(model)
    posed = head.pose(RefinedParameters(parameters, head.used)).detach().numpy()
    np.testing.assert_allclose(posed, pose(model, parameters), atol=1e-6)


def test_gradients_of_the_parameters_agree_with_finite_differences(capture):
    head = DifferentiableHead(full_model(capture.model))
    upstream = torch.from_numpy(np.random.default_rng(3).normal(size=capture.model.v_template.shape))
    for parameters in (HeadParameters(), random_parameters(4)):
        refined = RefinedParameters(parameters, head.used)
        leaves = {name: row.detach().double().requires_grad_(True) for name, row in refined.attributes()}

        def value(*rows, names=tuple(leaves)):
            moved = RefinedParameters(HeadParameters(), head.used)
            for name, row in zip(names, rows, strict=True):
                moved.rows[name] = row
            return (head.pose(moved) * upstream).sum()

        assert torch.autograd.gradcheck(value, tuple(leaves.values()), eps=1e-6, atol=1e-7)


def test_errors_of_the_tracking_that_differ_between_timesteps_shrink(capture, sequence, tmp_path):
    """An error that all timesteps share can be absorbed by the surfels; only differences are observable."""
    true = {t: sequence.posed(t, 0.0) for t in sequence.parameters}
    first, *others = sorted({frame.timestep for frame in capture.split("train")})
    wrong = np.array([0.004, -0.003, 0.0])
    for t in others:
        before = sequence.parameters[t]
        sequence.set_parameters(t, replace(before, translation=before.translation + wrong))
    train_surfels(replace(SETTINGS, iterations=150), TrainingSubject(sequence, Supervision(capture)))
    error = {t: (sequence.posed(t, 0.0) - true[t]).mean(axis=0) for t in (first, *others)}
    apart = [np.linalg.norm(error[t] - error[first]) for t in others]
    assert max(apart) < 0.5 * np.linalg.norm(wrong)


def test_an_interrupted_run_ends_in_the_same_bytes(capture, sequence, tmp_path, monkeypatch):
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)

    def run(checkpoint, on_step=None):
        own = replace(sequence, parameters=dict(sequence.parameters))
        surfels, _ = train_surfels(
            SETTINGS, TrainingSubject(own, Supervision(capture)), Checkpoint(checkpoint, "key"), on_step
        )
        refined = [getattr(own.parameters[t], name) for t in own.parameters for name in ("translation", "joints")]
        return b"".join(value.tobytes() for value in (*to_arrays(surfels).values(), *refined))

    class Killed(Exception):
        pass

    def kill(state):
        if state.iteration == 25:
            raise Killed

    whole = run(tmp_path / "whole")
    with pytest.raises(Killed):
        run(tmp_path / "parts", kill)
    assert run(tmp_path / "parts") == whole


def test_timesteps_without_training_frames_are_not_refined(capture, sequence):
    trained = sorted({frame.timestep for frame in capture.split("train")})
    refinement = TrackingRefinement(sequence, trained)
    assert sorted(refinement.parameters) == trained
    assert set(sequence.parameters) - set(trained)


@pytest.mark.parametrize("until", [0.0, 0.5, 1.0])
def test_only_the_first_steps_refine(capture, sequence, tmp_path, until):
    """The parameters change in these steps and in no other."""
    values = [[sequence.parameters[t].translation for t in sequence.parameters]]

    def look(state):
        values.append([sequence.parameters[t].translation for t in sequence.parameters])

    refinement = replace(SETTINGS.refine_tracking, until=until)
    settings = replace(SETTINGS, iterations=12, refine_tracking=refinement)
    train_surfels(settings, TrainingSubject(sequence, Supervision(capture)), on_step=look)
    changed = [not np.array_equal(before, after) for before, after in pairwise(values)]
    assert changed == [i < 12 * until for i in range(12)]
