"""The displacement that brings a head's outline onto mattes: of a head whose true shape is known."""

from dataclasses import replace

import numpy as np
import pytest
from small_head import ring_of_cameras, small_head

from carigs.head import HeadModel, HeadParameters, SurfacePoints, neutral, pose
from carigs.raster import compute_visibility
from carigs.tracking.outline.outline_offset import OutlineView, outline_offset

SKIN, HAIR = (200, 140, 120), (30, 25, 20)
SCALE = 0.7
"""Of the head: the work grows with the sixth power of its size, because displacements change over a given length."""
CAMERAS = ring_of_cameras(7, size=500, focal=1800.0 / SCALE)
BUMP = 0.006
"""Metres."""


@pytest.fixture(scope="module")
def model() -> HeadModel:
    head = small_head(subdivisions=4)
    vertices = head.v_template
    side = np.abs(vertices[:, 0]) > 0.06
    regions = {
        "face": np.flatnonzero((vertices[:, 1] < 0.05) & ~side),
        "left_ear": np.flatnonzero(side & (vertices[:, 0] > 0) & (vertices[:, 1] < 0.05)),
        "right_ear": np.flatnonzero(side & (vertices[:, 0] < 0) & (vertices[:, 1] < 0.05)),
        "scalp": np.flatnonzero(vertices[:, 1] >= 0.05),
    }
    return replace(head, v_template=SCALE * vertices, regions=regions)


def landmarks(model: HeadModel) -> SurfacePoints:
    return SurfacePoints.at_vertices(model.regions["face"][::4])


def bump(model: HeadModel) -> np.ndarray:
    """One ear stands out, over some centimetres."""
    vertices = model.v_template.astype(np.float64)
    place = vertices[vertices[:, 0].argmax()]
    height = BUMP * np.exp(-(np.linalg.norm(vertices - place, axis=1) ** 2) / 2 / (0.02 * SCALE) ** 2)
    return height[:, None] * [1.0, 0.0, 0.0]


def views_of(model: HeadModel, offset: np.ndarray, edge: tuple[int, int, int] = SKIN) -> list[OutlineView]:
    """Mattes of a head with an offset that its parameters do not have; its rim has a colour."""
    known = HeadParameters.zeros(model)
    true = replace(known, static_offset=offset)
    views = []
    for camera in CAMERAS:
        silhouette = compute_visibility(pose(model, true), model.faces, camera).face >= 0
        inner = compute_visibility(0.93 * pose(model, true), model.faces, camera).face >= 0
        image = np.full((*silhouette.shape, 3), SKIN, np.uint8)
        image[~inner] = edge
        views.append(OutlineView(camera, known, image, silhouette.astype(np.float32)))
    return views


def test_a_bump_on_the_outline_is_found(model):
    true = bump(model)
    offset = outline_offset(model, views_of(model, true), landmarks(model))
    rim = np.flatnonzero((true[:, 0] > BUMP / 2) & (model.v_template[:, 2] > -0.02 * SCALE))
    wrong = np.abs(offset - true)[rim, 0]  # along the bump: an outline does not tell what slides along it
    assert wrong.mean() < 0.15 * BUMP
    assert wrong.max() < 0.35 * BUMP
    # An edge of a pixel says where the head is to half of that: .5 mm.
    far = np.flatnonzero((true[:, 0] < 1e-5) & model.vertex_region("face", "left_ear", "right_ear"))
    assert np.linalg.norm(offset[far], axis=1).mean() < 3e-4
    joints = model.joint_regressor @ offset
    assert np.linalg.norm(joints, axis=1).max() < 5e-5


def test_a_head_that_fits_stays(model):
    views = views_of(model, np.zeros_like(model.v_template))
    offset = outline_offset(model, views, landmarks(model))
    assert np.linalg.norm(offset, axis=1).mean() < 1.5e-4
    assert np.linalg.norm(offset, axis=1).max() < 1.5e-3  # three pixels, where one view alone shows an outline


def test_an_edge_of_another_colour_than_the_face_is_not_followed(model):
    """Hair or a collar."""
    offset = outline_offset(model, views_of(model, bump(model), HAIR), landmarks(model))
    assert np.abs(offset).max() < 0.05 * BUMP


def test_the_static_offset_that_a_head_has_is_where_it_begins(model):
    true = bump(model)
    views = views_of(model, true)
    known = [replace(view, parameters=replace(view.parameters, static_offset=true)) for view in views]
    assert np.linalg.norm(outline_offset(model, known, landmarks(model)), axis=1).mean() < 1.5e-4
    rest = neutral(model, known[0].parameters)
    assert np.abs(rest - model.v_template - true).max() < 1e-6


def test_views_without_a_matte_give_nothing(model):
    views = [replace(view, alpha=np.ones_like(view.alpha)) for view in views_of(model, bump(model))]
    assert not outline_offset(model, views, landmarks(model)).any()


def test_a_model_without_regions_keeps_its_outline(model):
    """Such as FLAME without its file of regions."""
    offset = outline_offset(replace(model, regions={}), views_of(model, bump(model)), landmarks(model))
    assert offset.shape == model.v_template.shape
    assert not offset.any()
