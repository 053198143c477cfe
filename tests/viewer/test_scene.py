"""The fast way from values of the controls to surfels gives what the library gives."""

import numpy as np
import pytest
from avatars import CAMERA, ball_avatar

from carigs.exaggeration import Caricature
from carigs.head import pose, posed_changes
from carigs.library import HeadAvatar
from carigs.viewer.controls import controls_of
from carigs.viewer.exact_mode import exact_image
from carigs.viewer.scene import HeadScene
from carigs.viewer.state import State, parameters_of

MOVED = {"level": 0.2, "frame": 2, "expression:1": 0.7, "jaw:x": 12.0, "neck:y": -20.0}


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


def values_of(avatar, **moved):
    state = State(controls_of(avatar))
    for name, value in moved.items():
        state.set(name, value, 0.0)
    return state.values


def with_changing_blendshapes(avatar):
    """The same avatar, whose caricatures change an expression and a pose corrective as well."""
    sequence, random = avatar.avatar.sequence, np.random.default_rng(0)
    columns = np.array([1, sequence.head.num_expressions + 4])
    shape = (len(sequence.path.levels) - 1, len(columns), *sequence.head.v_template.shape)
    object.__setattr__(sequence.path, "columns", columns)
    object.__setattr__(sequence.path, "changes", (0.01 * random.normal(size=shape)).astype(np.float32))
    return avatar


def test_changes_of_the_posed_head_are_differences_of_poses(avatar):
    sequence, random = avatar.avatar.sequence, np.random.default_rng(0)
    parameters = parameters_of(avatar, values_of(avatar, **MOVED))
    shape = sequence.head.v_template.shape
    columns = np.array([1, sequence.head.num_expressions + 4])
    caricatures = [
        Caricature(0.01 * random.normal(size=shape), columns, 0.01 * random.normal(size=(2, *shape))) for _ in range(3)
    ]
    natural = pose(sequence.head, parameters)
    for change, caricature in zip(posed_changes(sequence.head, parameters, caricatures), caricatures, strict=True):
        np.testing.assert_allclose(change, pose(sequence.head, parameters, caricature) - natural, atol=1e-12)


@pytest.mark.parametrize("level", [0.0, 0.1, 0.25])
def test_the_posed_mesh_is_that_of_the_head_model(level):
    avatar = with_changing_blendshapes(HeadAvatar(ball_avatar()))
    scene, sequence = HeadScene(avatar), avatar.avatar.sequence
    values = values_of(avatar, **{**MOVED, "level": level})
    expected = pose(sequence.head, parameters_of(avatar, values), sequence.path.at(level) if level else None)
    np.testing.assert_allclose(scene.vertices(values), expected, atol=2e-8)


def test_regions_are_added(avatar):
    scene = HeadScene(avatar)
    values = values_of(avatar, **{"level": 0.1, "region:scalp": 0.2})
    expected, _ = avatar.mesh(level=0.1, regions={"scalp": 0.2})
    np.testing.assert_allclose(scene.vertices(values), expected, atol=2e-8)


@pytest.mark.parametrize("sh_degree", [0, 3])
def test_exact_images_are_those_of_the_library(sh_degree):
    avatar = HeadAvatar(ball_avatar(sh_degree=sh_degree))
    values = values_of(avatar, level=0.2, frame=2)
    image = exact_image(HeadScene(avatar).surfels(values, CAMERA.centre), CAMERA, 1.0)
    np.testing.assert_allclose(image, avatar.render(CAMERA, level=0.2, timestep=2), atol=1e-4)
    np.testing.assert_allclose(HeadScene(avatar).posed_head(values).render(CAMERA), image, atol=1e-6)


def test_shading_lags_behind_while_something_moves(avatar):
    scene, fresh = HeadScene(avatar), HeadScene(avatar)
    first, second = values_of(avatar, level=0.0), values_of(avatar, level=0.25)
    np.testing.assert_array_equal(scene.shade(first, settled=False), fresh.shade(first))
    np.testing.assert_array_equal(scene.shade(second, settled=False), fresh.shade(first))
    np.testing.assert_array_equal(scene.shade(second), fresh.shade(second))
    assert np.abs(fresh.shade(second) - fresh.shade(first)).max() > 1e-3


def test_an_overlay_covers_the_colours(avatar):
    scene, values = HeadScene(avatar), values_of(avatar)
    red = np.tile(np.float32([1, 0, 0]), (len(avatar.avatar.sequence.head.faces), 1))
    covered = scene.surfels(values, CAMERA.centre, face_colours=red, cover=1.0)
    np.testing.assert_allclose(covered.colour.numpy(), np.tile([1.0, 0, 0], (len(covered.colour), 1)))
