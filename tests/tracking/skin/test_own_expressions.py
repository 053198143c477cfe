"""Movements of the skin that a head model lacks: of a textured head that moves as its parameters do not say."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_head import small_head

from carigs.capture import Camera, look_at
from carigs.head import HeadModel, HeadParameters, neutral, pose
from carigs.raster import rasterize_mesh
from carigs.tracking.skin.face_chart import face_chart
from carigs.tracking.skin.own_expressions import MODES, own_expressions

COUNT, SIDE, SIZE = 16, 160, 240
MOVED = 0.0015
"""Metres."""
CAMERA = Camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 900.0, 900.0, SIZE / 2, SIZE / 2, SIZE, SIZE)


@pytest.fixture(scope="module")
def model() -> HeadModel:
    head = small_head(subdivisions=4)
    front = head.v_template[:, 2] > 0.01
    return replace(head, regions={"face": np.flatnonzero(front), "scalp": np.flatnonzero(~front)})


def paint(points: np.ndarray) -> np.ndarray:
    """Grey values at points of the skin, with details of some millimetres."""
    waves = np.random.default_rng(3).normal(size=(12, 3)) * 500
    return 0.5 + 0.05 * np.sin(points @ waves.T + np.arange(12)).sum(axis=-1)


def frames(model: HeadModel, amplitudes: np.ndarray) -> tuple[list[HeadParameters], np.ndarray, list]:
    """Known parameters, the displacement that they lack, and images of both."""
    rest = neutral(model, HeadParameters.zeros(model))
    shape = MOVED * np.exp(-(np.linalg.norm(rest - rest[rest[:, 2].argmax()], axis=1, keepdims=True) ** 2) / 0.001)
    shape = shape * [1.0, 0.4, 0.0]  # nearly along the skin, which looks along z there
    known, images = [], []
    for i, amplitude in enumerate(amplitudes):
        turn = np.array([0.1 * np.sin(i), 0.25 * np.cos(2 * i), 0.0])
        parameters = replace(HeadParameters.zeros(model), rotation=turn)
        vertices = pose(model, replace(parameters, static_offset=amplitude * shape))
        hit = rasterize_mesh(vertices, model.faces, CAMERA)
        points = np.einsum("hwc,hwcx->hwx", hit.barycentric, rest[model.faces[hit.face]])
        alpha = (hit.face >= 0).astype(np.float32)
        grey = np.where(alpha > 0, paint(points), 1.0).clip(0, 1)
        images.append((np.repeat((255 * grey[..., None]).astype(np.uint8), 3, axis=2), alpha))
        known.append(parameters)
    return known, shape, images


def found(model: HeadModel, amplitudes: np.ndarray):
    known, shape, images = frames(model, amplitudes)
    chart = face_chart(model, neutral(model, known[0]), SIDE)
    skin = [
        chart.unwrap(image, alpha, pose(model, parameters), CAMERA)
        for (image, alpha), parameters in zip(images, known, strict=True)
    ]
    return chart, shape, skin, own_expressions(model, known, chart, skin, list(range(len(known))))


@pytest.fixture(scope="module")
def still(model):
    """A head that moves as its parameters say."""
    return found(model, np.zeros(COUNT))


def test_the_chart_shows_the_same_skin_in_every_pose(still):
    chart, _, skin, _ = still
    seen = np.minimum.reduce([frame.weight for frame in skin]) > 0.9
    assert seen.sum() > 0.3 * chart.inside.sum() > 1000
    images = np.stack([frame.image for frame in skin])[:, seen]
    assert images.std(axis=0).mean() < 0.2 * images.std()


def test_a_large_frame_gives_the_chart_of_a_small_one(model, still):
    chart, known = still[0], HeadParameters.zeros(model)
    sizes = {"cx": 2.0 * SIZE, "cy": 2.0 * SIZE, "width": 4 * SIZE, "height": 4 * SIZE}
    large, random = replace(CAMERA, fx=4 * CAMERA.fx, fy=4 * CAMERA.fy, **sizes), np.random.default_rng(0)
    image = np.repeat(
        (128 + 200 * cv2.GaussianBlur(random.normal(size=(SIZE, SIZE)), (0, 0), 2))
        .clip(0, 255)
        .astype(np.uint8)[..., None],
        3,
        axis=2,
    )
    fine = np.kron(image, np.ones((4, 4, 1), int)) + random.integers(-40, 41, (4 * SIZE, 4 * SIZE, 1))  # noise
    vertices = pose(model, known)
    frames = [
        chart.unwrap(pixels.clip(0, 255).astype(np.uint8), np.ones(pixels.shape[:2], np.float32), vertices, camera)
        for pixels, camera in ((image, CAMERA), (fine, large))
    ]
    seen = (frames[0].weight > 0.9) & (frames[1].weight > 0.9)
    differs = (frames[0].image - frames[1].image)[seen]
    assert differs.std() < 0.35 * frames[0].image[seen].std()


def test_a_movement_that_the_model_lacks_becomes_an_expression(model):
    amplitudes = np.random.default_rng(0).normal(size=COUNT)
    amplitudes -= amplitudes.mean()
    chart, shape, skin, (larger, parameters) = found(model, amplitudes)
    added = larger.num_expressions - model.num_expressions
    assert added == COUNT // 4 <= MODES
    own = np.stack([frame.expression[-added:] for frame in parameters])
    np.testing.assert_allclose((own**2).mean(axis=0), 1, rtol=1e-6)
    moved = np.einsum("te,vxe->tvx", own, larger.expression_basis[chart.vertices][..., -added:])
    true = amplitudes[:, None, None] * shape[chart.vertices]
    inner = np.linalg.norm(shape[chart.vertices], axis=1) > 0.2 * MOVED
    wrong = np.linalg.norm((moved - true)[:, inner, :2], axis=-1).mean()
    assert wrong < 0.3 * np.linalg.norm(true[:, inner], axis=-1).mean()
    named = replace(model, expression_names=("smile",) * model.num_expressions)
    again, _ = own_expressions(named, parameters, chart, skin, list(range(COUNT)))
    assert len(set(again.expression_names)) == 1 + added
    # Expressions without a name stay behind those with one, and names still say which is which.
    known = model.num_expressions - 1
    some = replace(model, expression_names=tuple(f"e{i}" for i in range(known)))
    without = [replace(frame, expression=frame.expression[:-added]) for frame in parameters]
    mixed, moving = own_expressions(some, without, chart, skin, list(range(COUNT)))
    assert mixed.expression_names[known:] == tuple(f"own_{known + i}" for i in range(added))
    np.testing.assert_array_equal(mixed.expression_basis[..., -1], model.expression_basis[..., -1])
    for one, other in zip(moving, parameters, strict=True):
        np.testing.assert_allclose(pose(mixed, one), pose(larger, other), atol=1e-7)
    # The first of them is this movement.
    assert abs(np.corrcoef(own[:, 0], amplitudes)[0, 1]) > 0.97
    assert np.isfinite(pose(larger, parameters[0])).all()


def test_a_head_that_moves_as_its_parameters_say_gets_expressions_that_do_little(model, still):
    chart, _, _, (larger, _) = still
    own = larger.expression_basis[..., model.num_expressions :][chart.vertices]
    assert np.sqrt((own**2).sum(axis=(1, 2))).mean() < 0.15 * MOVED


def test_few_timesteps_and_models_without_regions_change_nothing(model, still):
    chart, _, skin, _ = still
    known = [HeadParameters.zeros(model)] * 3
    assert own_expressions(model, known, chart, skin[:3], [0, 1, 2]) == (model, known)
    assert face_chart(replace(model, regions={}), neutral(model, known[0]), SIDE) is None
