"""A body below the neck of the procedural head is told from hair, and moves with the border of the neck."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.capture import Camera, look_at
from carigs.hair.body import carve_body, shows_body
from carigs.hair.covered_faces import covered_faces
from carigs.hair.views import HairView
from carigs.hair.volume import carve_hair
from carigs.head import HeadParameters, pose
from carigs.head.neck_border import neck_border
from carigs.raster import compute_visibility
from carigs.toy import head_model

SIZE, FOCAL = 200, 320.0
MODEL = head_model()
BORDER = neck_border(MODEL, MODEL.v_template)
CENTRE = BORDER.centre - [0, 0.12, 0]
RADII = np.array([0.17, 0.13, 0.08])
"""Of an ellipsoid below the neck."""


def cameras(degrees) -> list[Camera]:
    for angle in np.radians(degrees):
        eye = BORDER.centre + 0.9 * np.array([np.sin(angle), 0.05, np.cos(angle)])
        yield Camera(look_at(eye, BORDER.centre), FOCAL, FOCAL, SIZE / 2, SIZE / 2, SIZE, SIZE)


def on_ellipsoid(camera: Camera, motion: np.ndarray) -> np.ndarray:
    """Pixels whose rays meet the ellipsoid after a rigid motion."""
    column, row = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    rays = np.stack([(column - camera.cx) / FOCAL, (row - camera.cy) / FOCAL, np.ones_like(row)], axis=-1)
    rays = rays @ camera.camera_from_world[:3, :3] @ motion[:3, :3] / RADII
    start = (motion[:3, :3].T @ (camera.centre - motion[:3, 3]) - CENTRE) / RADII
    a, b, c = (rays**2).sum(axis=-1), rays @ start, start @ start - 1
    return b**2 > a * c


def views(degrees=range(-80, 81, 20), body=True, turns=(0.0, 0.3, -0.3)) -> list[HairView]:
    """The head turns at the neck; the body stays with the root, which moves, too."""
    found = []
    for k, turn in enumerate(turns):
        root = Rotation.from_rotvec([0, 0.05 * k, 0.02 * k])
        zero = HeadParameters.zeros(MODEL)
        joints = zero.joints.copy()
        joints[0] = [0, turn, 0]
        parameters = replace(zero, rotation=root.as_rotvec(), translation=np.array([0.01 * k, 0, 0]), joints=joints)
        posed = pose(MODEL, parameters)
        base = MODEL.joint_template[0]
        motion = np.eye(4)
        motion[:3, :3] = root.as_matrix()
        motion[:3, 3] = base - root.apply(base) + parameters.translation
        for camera in cameras(degrees):
            seen = compute_visibility(posed, MODEL.faces, camera)
            matte = (seen.face >= 0) | (on_ellipsoid(camera, motion) if body else False)
            image = np.where(matte[..., None], np.float32(0.5), np.float32(1))
            found.append(HairView(image, matte.astype(np.float32), seen, np.zeros(matte.shape, bool)))
    return found


@pytest.fixture(scope="module")
def seen() -> list[HairView]:
    return views()


@pytest.mark.parametrize("degrees", [[0], range(-80, 81, 20), [-40, 0, 40]])
def test_a_body_is_noticed_where_there_is_one(degrees):
    turns = np.linspace(-0.3, 0.3, 9 if len(degrees) < 4 else 3)
    with_body, without = views(degrees, turns=turns), views(degrees, body=False, turns=turns)
    assert shows_body(with_body, BORDER, MODEL.v_template, MODEL.faces)
    assert not shows_body(without, BORDER, MODEL.v_template, MODEL.faces)


def test_its_voxels_fill_the_body_and_nothing_else(seen):
    volume, visible = carve_body(seen, BORDER, MODEL.v_template, MODEL.faces)
    inside = (((volume.centres - CENTRE) / RADII) ** 2).sum(axis=1)
    solid = volume.opacity > 0.5
    assert np.quantile(inside[solid], 0.9) < 1.35  # a hull of views from one side is larger
    shown = solid & (visible > 0)
    front = shown & (volume.centres[:, 2] > CENTRE[2])
    assert (inside[front] > 0.5).mean() > 0.8
    assert volume.centres[shown, 1].min() < CENTRE[1] - 0.08
    assert not BORDER.lies_above(volume.centres).any()


def test_before_one_camera_it_is_no_deeper_than_bodies_are():
    volume, _ = carve_body(views([0], turns=np.linspace(-0.3, 0.3, 9)), BORDER, MODEL.v_template, MODEL.faces)
    assert np.ptp(volume.centres[:, 0]) > 0.3
    assert np.ptp(volume.centres[:, 2]) < 0.27


def test_without_a_body_there_are_no_voxels():
    volume, visible = carve_body(views([0, 40], body=False), BORDER, MODEL.v_template, MODEL.faces)
    assert len(volume.centres) == len(visible) == 0


def test_it_is_no_hair(seen):
    scalp, none = MODEL.face_region("scalp"), np.zeros(len(MODEL.faces), bool)
    covering = covered_faces(seen, MODEL.faces, MODEL.v_template, scalp, none, none)
    hair = carve_hair(seen, covering, scalp, MODEL.v_template, MODEL.faces, border=BORDER)
    assert (hair.opacity.sum() * hair.size**3) < 1e-4  # a tenth of a litre
