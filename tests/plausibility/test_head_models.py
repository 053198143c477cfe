"""Joints and skinning weights in another order than their names."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from miniature import ball_model

from carigs.head.model_arrays import FLAME_JOINTS
from carigs.plausibility.head_models import check_head_model


def head_with_eyes():
    """A ball whose sides are eyes; the neck's joint lies at the bottom, that of the jaw in the middle."""
    model = ball_model()
    x, y, _ = (model.v_template / np.abs(model.v_template).max()).T
    parts = {
        "root": np.abs(x) <= 0.7,
        "neck": y < -0.7,
        "jaw": np.abs(y) < 2,
        "left_eye": x > 0.7,
        "right_eye": x < -0.7,
    }
    weights = np.stack([parts[name] & (name not in ("neck", "jaw")) for name in FLAME_JOINTS], axis=1)
    regressor = np.stack([parts[name] / parts[name].sum() for name in FLAME_JOINTS])
    return replace(model, weights=weights.astype(np.float32), joint_regressor=regressor.astype(np.float32))


def test_joints_in_their_places_are_believed():
    assert check_head_model(head_with_eyes(), Path("model.npz")) == []
    without_eyes = replace(
        head_with_eyes(), weights=np.eye(5, dtype=np.float32)[np.zeros(len(ball_model().v_template), int)]
    )
    assert check_head_model(without_eyes, Path("model.npz")) == []


@pytest.mark.parametrize(
    "field, order, says",
    [("weights", [0, 1, 2, 4, 3], "left_eye"), ("joint_regressor", [0, 1, 3, 2, 4], "left_eye"),
     ("joint_regressor", [0, 2, 1, 3, 4], "above that of the jaw")],
)  # fmt: skip
def test_exchanged_joints_and_weights_are_named(field, order, says):
    model = head_with_eyes()
    values = getattr(model, field)
    exchanged = replace(model, **{field: values[:, order] if field == "weights" else values[order]})
    found = " ".join(f"{finding.kind} {finding.details}" for finding in check_head_model(exchanged, Path("model.npz")))
    assert says in found
