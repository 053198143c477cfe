"""Points inside the mouth, on the procedural head."""

from dataclasses import replace

import numpy as np
import pytest
from mouth.test_jaws import FRAMES, LINE, MODEL, POSED, REST

from carigs.capture import Camera, look_at
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.rigid_alignment import rigid_alignment
from carigs.mesh.triangle_mesh import barycenters, size
from carigs.mouth import Jaw, find_jaws, place_in_mouth

OPEN, CLOSED = POSED[1], POSED[0]


def camera(x: float, y: float) -> Camera:
    middle = FRAMES[0].translation + LINE.middle
    return Camera(look_at(middle + np.array([x, y, 0.5]), middle), 800.0, 800.0, 100.0, 100.0, 200, 200)


CAMERAS = [camera(0.0, 0.0), camera(0.2, 0.05), camera(-0.2, -0.05)]


@pytest.fixture(scope="module")
def jaws() -> np.ndarray:
    return find_jaws(MODEL, REST, POSED, LINE)


def placed(jaws, views, count=500, seed=0):
    return place_in_mouth(MODEL, REST, views, LINE, jaws, count, np.random.default_rng(seed))


def test_points_are_seen_between_the_lips_of_the_open_mouth(jaws):
    """By rays that do not know of the placement: most points are seen by a camera, none before the mouth opens."""
    points = placed(jaws, [(OPEN, CAMERAS)])
    assert len(points.face) == 500
    upper = jaws[points.face] == Jaw.UPPER
    unit = size(REST, MODEL.faces)
    seen = {}
    for name, posed in (("open", OPEN), ("closed", CLOSED)):
        moved = np.empty_like(points.position)
        for jaw, mine in ((Jaw.UPPER, upper), (Jaw.LOWER, ~upper)):
            carriers = MODEL.faces[jaws == jaw]
            source, target = barycenters(REST, carriers), barycenters(posed, carriers)
            turn, offset = rigid_alignment(source, target, np.ones(len(source)))
            moved[mine] = points.position[mine] @ turn.T + offset
        scale = size(posed, MODEL.faces)
        caster, shown = RayCaster(posed, MODEL.faces), np.zeros(len(moved), bool)
        for view in CAMERAS:
            ray = moved - view.centre
            length = np.linalg.norm(ray, axis=1, keepdims=True)
            _, distance, _ = caster.first_hit(np.tile(view.centre / scale, (len(ray), 1)), ray / length)
            shown |= distance * scale > length[:, 0]
        seen[name] = shown.mean()
    assert unit == pytest.approx(size(OPEN, MODEL.faces), rel=0.1)
    assert seen["open"] > 0.85
    assert seen["closed"] < 0.05


def test_points_above_the_lips_hang_on_the_upper_jaw(jaws):
    points = placed(jaws, [(OPEN, CAMERAS)])
    height, step = LINE.height(points.position), LINE.width / 40
    upper = jaws[points.face] == Jaw.UPPER
    assert set(jaws[points.face]) == {Jaw.UPPER, Jaw.LOWER}
    assert height[upper].min() > -step and height[~upper].max() < step
    assert LINE.depth(points.position).min() > 0


def test_what_no_camera_sees_has_no_points(jaws):
    behind = look_at(np.array([0.1, 0.0, -0.5]), np.array([0.1, 0.0, 0.2]))
    for views in ([(OPEN, [replace(CAMERAS[0], camera_from_world=behind)])], [(OPEN, [])], []):
        assert len(placed(jaws, views).face) == 0


def test_the_seed_draws_the_points_and_their_number_sets_the_spacing(jaws):
    views = [(OPEN, CAMERAS)]
    few, again, other = placed(jaws, views), placed(jaws, views), placed(jaws, views, seed=1)
    np.testing.assert_array_equal(few.position, again.position)
    assert not np.array_equal(few.position, other.position)
    many = placed(jaws, views, count=4000)
    assert np.median(few.spacing) == pytest.approx(2 * np.median(many.spacing), rel=0.1)
