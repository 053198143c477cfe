"""Regions of a frame: areas that are known, visibility, and what is said when the head model lacks a mask."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_model
from scipy.ndimage import distance_transform_edt

from carigs.capture import Camera, look_at
from carigs.head import SurfacePoints
from carigs.raster import rasterize_mesh
from evaluation.metrics.regions import image_regions, surface_regions
from evaluation.tables.metric_records import REGIONS

SIZE = 200


@pytest.fixture(scope="module")
def model():
    """The ball with eyes, lips, ears, and landmarks in the places that regions read."""
    model = ball_model(4)
    v = model.v_template
    front = v[:, 2] > 0

    def patch(centre, radius):
        return np.flatnonzero(np.linalg.norm(v[:, :2] - centre, axis=1) * np.where(front, 1, 9) < radius)

    def nearest(x, y):
        return int(np.argmin(np.linalg.norm(v[:, :2] - (x, y), axis=1) + 9 * ~front))

    landmarks = np.zeros(68, np.int64)
    landmarks[36], landmarks[45] = nearest(-0.05, 0.02), nearest(0.05, 0.02)
    landmarks[17:22] = [nearest(x, 0.045) for x in np.linspace(-0.05, -0.015, 5)]
    landmarks[22:27] = [nearest(x, 0.045) for x in np.linspace(0.015, 0.05, 5)]
    angles = np.radians(180 - 30 * np.arange(12))  # from the right corner of the mouth over the upper lip
    landmarks[48:60] = [nearest(0.03 * np.cos(a), -0.04 + 0.012 * np.sin(a)) for a in angles]
    regions = {
        **model.regions,
        "lips": np.setdiff1d(patch((0, -0.04), 0.03), patch((0, -0.04), 0.02)),
        "left_eyeball": patch((0.035, 0.02), 0.012),
        "right_eyeball": patch((-0.035, 0.02), 0.012),
        "eye_region": np.concatenate([patch((0.035, 0.02), 0.03), patch((-0.035, 0.02), 0.03)]),
        "left_ear": np.flatnonzero(v[:, 0] > 0.09),
        "right_ear": np.flatnonzero(v[:, 0] < -0.09),
    }
    return replace(model, regions=regions, landmarks68=SurfacePoints.at_vertices(landmarks))


def camera_at(x, z):
    return Camera(look_at(np.array([x, 0.0, z]), np.zeros(3)), 800, 800, SIZE / 2, SIZE / 2, SIZE, SIZE)


def seen(model, camera, foreground=None, band=2):
    vertices = model.v_template.astype(np.float64)
    fragments = rasterize_mesh(vertices, model.faces, camera)
    mesh = fragments.face >= 0
    foreground = mesh if foreground is None else foreground(mesh)
    surface = surface_regions(model, vertices)
    return mesh, image_regions(surface, vertices, fragments, camera, foreground, band=band)


def test_every_region_is_seen_from_the_front(model):
    _, regions = seen(model, camera_at(0, 1))
    assert set(regions) == set(REGIONS)
    assert all(regions[name].any() for name in REGIONS)


def test_regions_that_exclude_each_other_do_not_overlap(model):
    _, regions = seen(model, camera_at(0.3, 1))
    for a, b in (("skin", "hair"), ("skin", "mouth"), ("skin", "brow"), ("head_hm", "hair"), ("head_hm", "mouth"),
                 ("silhouette", "hair"), ("eyes", "mouth"), ("hair", "face")):  # fmt: skip
        assert not (regions[a] & regions[b]).any(), (a, b)


def test_surface_regions_lie_on_the_mesh(model):
    mesh, regions = seen(model, camera_at(0.3, 1))
    for name in ("face", "eyes", "brow", "skin", "neck_ear"):
        assert not (regions[name] & ~mesh).any()


def test_the_front_of_the_face_is_not_seen_from_behind(model):
    _, regions = seen(model, camera_at(0, -1))
    for name in ("face", "eyes", "brow", "mouth"):
        assert not regions[name].any(), name
    assert regions["hair"].any()


def test_the_mouth_is_filled_between_the_lips(model):
    # The lips are a ring around (0, -0.04): only the landmarks' outline covers its middle.
    camera = camera_at(0, 1)
    mesh, regions = seen(model, camera)
    x, y = camera.project(np.array([[0.0, -0.04, 0.1]]))[0][0].astype(int)
    assert mesh[y, x] and regions["mouth"][y, x]


def test_lids_are_the_part_of_the_eye_region_that_is_near_the_eyeball(model):
    camera = camera_at(0, 1)
    _, regions = seen(model, camera)
    for distance, inside in ((0.0, True), (0.028, False)):  # the eyeball's patch has radius 0.012, the region 0.03
        x, y = camera.project(np.array([[0.035, 0.02 - distance, 0.09]]))[0][0].astype(int)
        assert regions["eyes"][y, x] == inside


@pytest.mark.parametrize("band", [1, 2, 4])
def test_the_silhouette_holds_the_pixels_within_its_band_of_the_outline(model, band):
    bald = replace(model, regions={**model.regions, "scalp": np.array([], np.int64)})
    mesh, regions = seen(bald, camera_at(0, 1), band=band)
    distance = np.where(mesh, distance_transform_edt(mesh), distance_transform_edt(~mesh))
    assert distance[regions["silhouette"]].max() <= band + 0.5
    assert distance[~regions["silhouette"]].min() > band - 0.5


@pytest.mark.parametrize("band", [2, 4])
def test_the_silhouette_keeps_its_band_away_from_hair(model, band):
    _, regions = seen(model, camera_at(0.3, 1), band=band)
    assert regions["silhouette"].any()
    assert distance_transform_edt(~regions["hair"])[regions["silhouette"]].min() > band - 0.5


def test_strands_off_the_mesh_are_hair_above_the_neck_only(model):
    mesh, regions = seen(model, camera_at(0, 1), foreground=np.ones_like)
    assert regions["hair"][2, SIZE // 2] and not mesh[2, SIZE // 2]
    assert not regions["hair"][-3].any()
    np.testing.assert_array_equal(regions["head"], True)


def test_background_is_no_hair(model):
    mesh, regions = seen(model, camera_at(0, 1))
    assert not (regions["hair"] & ~mesh).any()
    np.testing.assert_array_equal(regions["head"], mesh)


@pytest.mark.parametrize(
    ("mask", "lost"),
    [
        ("scalp", {"hair", "skin", "head_hm"}),
        ("lips", {"mouth", "head_hm"}),
        ("left_ear", {"neck_ear"}),
        ("right_eyeball", {"eyes"}),
        ("face", {"face"}),
    ],
)
def test_a_region_without_its_mask_is_left_out_with_a_reason(model, mask, lost):
    without = replace(model, regions={k: ids for k, ids in model.regions.items() if k != mask})
    _, regions = seen(without, camera_at(0, 1))
    assert set(REGIONS) - set(regions) == lost
    missing = surface_regions(without, without.v_template.astype(np.float64)).missing
    assert set(missing) == lost and all(mask in reason for reason in missing.values())


def test_brows_come_from_their_mask_or_from_landmarks_or_not_at_all(model):
    camera = camera_at(0, 1)
    brows = np.flatnonzero((model.v_template[:, 1] > 0.03) & (model.v_template[:, 2] > 0.05))
    masked = replace(model, regions={**model.regions, "brows": brows})
    assert seen(masked, camera)[1]["brow"].sum() > seen(model, camera)[1]["brow"].sum() > 0
    _, regions = seen(replace(model, landmarks68=None), camera)
    assert "brow" not in regions and regions["mouth"].any()
