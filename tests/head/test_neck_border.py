"""The border of the neck of the procedural head."""

from dataclasses import replace

import numpy as np
import pytest
from small_head import small_head

from carigs.head.neck_border import MARGIN, neck_border
from carigs.toy import head_model


@pytest.fixture(scope="module")
def model():
    return head_model()


def test_it_goes_around_the_neck_at_its_lower_end(model):
    border = neck_border(model, model.v_template)
    loop = model.v_template[border.vertices]
    assert loop[:, 1].max() < np.quantile(model.v_template[:, 1], 0.2)
    assert np.abs(border.centre[0]) < 0.005
    for axis in (0, 2):
        assert loop[:, axis].min() < border.centre[axis] - 0.03 < border.centre[axis] + 0.03 < loop[:, axis].max()
    carriers = model.v_template[model.faces[border.carriers]]
    assert carriers[..., 1].max() < border.height.max() + 0.05


def test_heads_lie_above_it_and_shoulders_below(model):
    border = neck_border(model, model.v_template)
    skull = model.v_template[np.unique(model.faces[model.face_region("scalp")])]
    assert border.lies_above(skull).all()
    for angle in np.linspace(0, 2 * np.pi, 9):
        away = border.centre + 0.2 * np.array([np.sin(angle), 0, np.cos(angle)])
        away[1] = border.height.min() - 0.001
        assert not border.lies_above(away[None])[0]
        away[1] = border.height.max() + MARGIN + 0.001
        assert border.lies_above(away[None])[0]


def test_only_triangles_that_move_with_the_root_carry_the_body(model):
    weights = np.zeros_like(model.weights)
    right = model.v_template[:, 0] < 0
    weights[right, 0], weights[~right, 1] = 1, 1
    border = neck_border(replace(model, weights=weights), model.v_template)
    assert border.carriers.any() and right[model.faces[border.carriers]].all()
    weights[:, 0], weights[:, 1] = 0.5, 0.5  # none does: all along the border carry it
    border = neck_border(replace(model, weights=weights), model.v_template)
    assert np.isin(border.vertices, model.faces[border.carriers]).all()


def test_a_closed_surface_has_none():
    closed = small_head()
    assert neck_border(closed, closed.v_template) is None
