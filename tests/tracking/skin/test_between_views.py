"""Points of a painted head's skin that three cameras see, which are off by what one of the cameras is off."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_head import small_head
from tracking.skin.test_own_expressions import paint

from carigs.capture import Camera, look_at
from carigs.footage import Footage
from carigs.head import HeadModel, HeadParameters, neutral, pose
from carigs.raster import rasterize_mesh
from carigs.tracking.cameras import Cameras
from carigs.tracking.skin.between_views import SimultaneousViews

COUNT, SIDE, SIZE, FOCAL = 3, 128, 240, 900.0
PLACES = [(np.sin(angle), 0.1, np.cos(angle)) for angle in (-0.5, 0.0, 0.5)]
CAMERAS = [Camera(look_at(np.array(p), np.zeros(3)), FOCAL, FOCAL, SIZE / 2, SIZE / 2, SIZE, SIZE) for p in PLACES]


@pytest.fixture(scope="module")
def model() -> HeadModel:
    head = small_head(subdivisions=4)
    front = head.v_template[:, 2] > 0.01
    return replace(head, regions={"face": np.flatnonzero(front), "scalp": np.flatnonzero(~front)})


@pytest.fixture(scope="module")
def parameters(model) -> list[HeadParameters]:
    zeros = HeadParameters.zeros(model)
    return [replace(zeros, rotation=np.array([0.1 * t, 0.1 - 0.1 * t, 0.0])) for t in range(COUNT)]


@pytest.fixture(scope="module")
def recorded(model, parameters) -> list[list[np.ndarray]]:
    """Images of each camera."""
    rest = neutral(model, parameters[0])

    def image(camera: Camera, frame: HeadParameters) -> np.ndarray:
        hit = rasterize_mesh(pose(model, frame), model.faces, camera)
        points = np.einsum("hwc,hwcx->hwx", hit.barycentric, rest[model.faces[hit.face]])
        grey = np.where(hit.face >= 0, paint(points), 1.0).clip(0, 1)
        return np.repeat((255 * grey[..., None]).astype(np.uint8), 3, axis=2)

    return [[image(camera, frame) for frame in parameters] for camera in CAMERAS]


def footage(images: Sequence[np.ndarray]) -> Footage:
    def decode() -> Iterator[np.ndarray]:
        return iter(images)

    numbers, times = tuple(range(COUNT)), np.arange(COUNT) / 25
    return Footage(
        Path("me.mp4"), SIZE, SIZE, numbers, times, fps=25.0, duration=None, focal_length=None, decode=decode
    )


def cameras(shift: float = 0.0) -> Cameras:
    """What is thought of the cameras, of which the first is off by a number of pixels."""
    centres = np.full((3, 2), SIZE / 2) + np.array([[shift, 0], [0, 0], [0, 0]])
    matrices = np.array([camera.camera_from_world for camera in CAMERAS])
    vectors = Rotation.from_matrix(matrices[:, :3, :3]).as_rotvec()
    return Cameras(np.full(3, FOCAL), centres, np.hstack([vectors, matrices[:, :3, 3]]))


def errors(model, parameters, recorded, shift: float, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each camera shows the points less where it is thought to; and where that is known."""
    views, thought = SimultaneousViews([footage(images) for images in recorded], shown), cameras(shift)
    skin = views.skin_points(model, parameters, thought, np.arange(COUNT), SIDE)
    posed = np.stack([skin.points.interpolate(pose(model, frame)) for frame in parameters])
    return skin.pixels - thought.project(posed)[0], skin.known


def test_cameras_in_their_places_agree(model, parameters, recorded):
    off, known = errors(model, parameters, recorded, 0.0, np.ones((COUNT, 3), bool))
    assert ((known > 0).sum(axis=1).max(axis=0) >= 2).mean() > 0.6
    assert np.linalg.norm(off, axis=-1)[known > 0].mean() < 0.15


def test_a_camera_in_a_wrong_place_disagrees_by_that_with_the_others(model, parameters, recorded):
    off, known = errors(model, parameters, recorded, 3.0, np.ones((COUNT, 3), bool))
    both = (known[:, 0] > 0) & (known[:, 1] > 0)
    between = (off[:, 0] - off[:, 1])[both]
    assert both.mean() > 0.2
    np.testing.assert_allclose(np.median(between, axis=0), [-3.0, 0.0], atol=0.4)


def test_a_point_counts_where_two_cameras_show_it(model, parameters, recorded):
    shown = np.array([[True, True, True], [True, False, False], [True, True, False]])
    _, known = errors(model, parameters, recorded, 0.0, shown)
    assert not known[~shown].any()
    assert not known[1].any()
    assert known[2, :2].any()


def test_without_the_regions_of_a_face_there_are_no_points(model, parameters, recorded):
    views = SimultaneousViews([footage(images) for images in recorded], np.ones((COUNT, 3), bool))
    assert views.skin_points(replace(model, regions={}), parameters, cameras(), np.arange(COUNT), SIDE) is None
