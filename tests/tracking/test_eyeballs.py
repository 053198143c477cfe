"""Eyeballs keep their form in a displaced head, and lids that close hide them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from carigs.head import HeadModel, HeadParameters, pose
from carigs.raster import compute_visibility
from carigs.toy import head_model
from carigs.tracking.cameras import Cameras
from carigs.tracking.eyeballs import eyes, lids_before_eyeballs, with_rigid_eyeballs

SIZE, FOCAL = 400, 1500.0
FORWARD = 0.006
"""Metres by which the eyeballs are moved out of the head."""
COUNT = 16


@pytest.fixture(scope="module")
def model() -> HeadModel:
    return head_model()


@pytest.fixture(scope="module")
def camera() -> Cameras:
    """One metre in front of the face."""
    return Cameras(np.full(1, FOCAL), np.full((1, 2), SIZE / 2), np.array([[np.pi, 0, 0, 0, 0, 1.0]]))


def displaced(model: HeadModel, metres: float) -> np.ndarray:
    offset = np.zeros(model.v_template.shape)
    offset[model.vertex_region("left_eyeball", "right_eyeball"), 2] = metres
    return offset


def blinking(model: HeadModel, offset: np.ndarray) -> list[HeadParameters]:
    """A person who turns the head and closes the eyes in every other frame."""
    blink = np.isin(model.expression_names, ("eye_blink_left", "eye_blink_right"))
    assert blink.sum() == 2
    zero = replace(HeadParameters.zeros(model), static_offset=offset)
    closed = np.zeros(model.num_expressions)
    closed[: len(blink)][blink] = 1
    turns = [np.array([0.1 * np.sin(i), 0.3 * np.cos(i), 0.0]) for i in range(COUNT)]
    return [replace(zero, rotation=turn, expression=closed * (i % 2)) for i, turn in enumerate(turns)]


def eyeball_pixels(model: HeadModel, parameters: HeadParameters, cameras: Cameras) -> int:
    """Pixels that show an eyeball."""
    seen = compute_visibility(pose(model, parameters), model.faces, cameras.pinholes([(SIZE, SIZE)])[0])
    ball = model.face_region("left_eyeball", "right_eyeball")
    return int(ball[seen.face[seen.face >= 0]].sum())


def test_eyeballs_keep_their_form_and_go_with_their_lids(model):
    random = np.random.default_rng(0)
    offset = random.normal(0, 0.003, model.v_template.shape)
    moved = with_rigid_eyeballs(model, offset)
    found = eyes(model)
    assert len(found) == 2
    for eye in found:
        there = (model.v_template + moved)[eye.ball]
        np.testing.assert_allclose(pdist(there), pdist(model.v_template[eye.ball]), atol=1e-8)
        np.testing.assert_allclose(moved[eye.ball].mean(axis=0), offset[eye.lids].mean(axis=0))
    others = ~model.vertex_region("left_eyeball", "right_eyeball")
    np.testing.assert_array_equal(moved[others], offset[others])


def test_each_lid_belongs_to_the_eye_that_it_covers(model):
    for eye in eyes(model):
        sides = np.sign(model.v_template[eye.lids, 0])
        assert (sides == np.sign(model.v_template[eye.ball, 0].mean())).all()


def test_a_head_that_moves_as_a_whole_is_not_changed(model):
    offset = np.tile([0.01, -0.02, 0.03], (len(model.v_template), 1))
    np.testing.assert_allclose(with_rigid_eyeballs(model, offset), offset, atol=1e-12)


@pytest.mark.parametrize("closed", [slice(1, COUNT, 2), slice(1, 2)], ids=["a clip", "one moment"])
def test_closed_lids_hide_eyeballs_that_stood_in_front_of_them(model, camera, closed):
    natural = blinking(model, displaced(model, 0))[closed]
    parameters = blinking(model, displaced(model, FORWARD))[closed]
    larger, held = lids_before_eyeballs(model, parameters, camera)
    usual, before, after = (
        np.array([eyeball_pixels(head, frame, camera) for frame in frames])
        for head, frames in ((model, natural), (model, parameters), (larger, held))
    )
    assert (before > usual + 200).all()
    assert (after < usual + 0.1 * (before - usual)).all()


def test_the_camera_sees_every_point_where_it_was(model, camera):
    parameters = blinking(model, displaced(model, FORWARD))
    larger, held = lids_before_eyeballs(model, parameters, camera)
    for before, after in zip(parameters, held, strict=True):
        pixels, there = (
            camera.project(pose(head, frame)[None])[0][0, 0] for head, frame in ((model, before), (larger, after))
        )
        assert np.abs(pixels - there).max() < 0.3


def test_lids_that_lie_in_front_and_heads_without_eyeballs_are_left_as_they_are(model, camera):
    natural = blinking(model, displaced(model, 0))
    larger, parameters = lids_before_eyeballs(model, natural, camera)
    assert larger is model and parameters == natural
    blind = replace(model, regions={name: v for name, v in model.regions.items() if "eye" not in name})
    parameters = blinking(model, displaced(model, FORWARD))
    larger, held = lids_before_eyeballs(blind, parameters, camera)
    assert larger is blind and held == parameters
