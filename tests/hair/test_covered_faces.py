"""Which triangles does something cover?"""

import numpy as np
import pytest
from hair.hairy_ball import CAP, RADIUS, ball, first_hit, views

from carigs.hair import surface_cells
from carigs.hair.covered_faces import _as_around, covered_faces
from carigs.raster import compute_visibility


def find(seen, left_out=None, features=None):
    vertices, faces = ball()
    none = np.zeros(len(faces), bool)
    left_out, features = (none if each is None else each for each in (left_out, features))
    return covered_faces(list(seen), faces, vertices, none, left_out, features)


def heights():
    vertices, faces = ball()
    return vertices[faces].mean(axis=1)[:, 1] / RADIUS


@pytest.mark.parametrize("change", [{}, {"dots": True}, {"noise": 0.03}, {"brightness": 0.7}])
def test_the_cap_is_covered_and_the_rest_is_not(change):
    """Also if the skin has freckles, the images are noisy, or dark."""
    covered, height = find(views(**change)).covered, heights()
    # Strands hang over the rim in views from above, and views from below look under them.
    assert covered[(height > CAP + 0.15) & (height < 0.75)].mean() > 0.97
    seen = (height > -0.5) & (height < CAP - 0.3)
    assert covered[seen].mean() < 0.02


@pytest.mark.parametrize(("change", "lost"), [({}, 0.001), ({"noise": 0.05}, 0.005), ({"dots": True}, 0.05)])
def test_a_bald_ball_is_not_covered(change, lost):
    """Freckles of the size of a pixel are blurred differently in each view, which loses some skin."""
    found = find(views(hair=False, **change))
    assert found.covered.mean() < lost
    assert np.isfinite(found.texture).all()


def test_noise_does_not_change_the_texture():
    height = heights()
    cap = (height > CAP + 0.15) & (height < 0.75)
    plain, noisy = (np.median(find(views(noise=noise)).texture[cap]) for noise in (0, 0.03))
    assert noisy == pytest.approx(plain, rel=0.15)


def test_what_is_left_out_and_features_of_the_face_are_never_covered():
    height = heights()
    inside = (height > 0.5) & (height < 0.6)
    assert find(views()).covered[inside].mean() > 0.9
    found = find(views(), left_out=inside)
    assert not found.covered[inside].any() and (found.texture[inside] == 0).all()
    found = find(views(), features=inside)
    assert not found.covered[inside].any() and not found.hidden[inside].any()
    assert found.texture[inside].mean() > 0.03  # the light is not fitted to them


def test_triangles_that_no_view_sees_are_as_those_around_them():
    """Folds of an ear below hair are covered; those of an ear without hair are not."""
    vertices, faces = ball()
    height = heights()
    covered = height > CAP
    centres = vertices[faces].mean(axis=1) / RADIUS
    unseen = (np.abs(centres[:, 0]) < 0.3) & (centres[:, 2] > 0) & (np.abs(height - CAP) > 0.1)
    spread = _as_around(covered & ~unseen, ~unseen, faces, len(vertices))
    np.testing.assert_array_equal(spread, covered)
    nothing = np.zeros(len(faces), bool)
    assert not _as_around(covered, nothing, faces, len(vertices)).any()


def misplaced_stripes(seen):
    """Folds of skin, such as those of an ear, at another place in each view."""
    for k, view in enumerate(seen):
        point, on_ball = first_hit(view.visibility.camera, RADIUS)
        folded = on_ball & (np.abs(point[..., 1] / RADIUS + 0.3) < 0.2)
        shade = 1 + 0.2 * np.sign(np.sin(point[..., 1] * 2 * np.pi / 0.006 + 2.4 * k))
        yield view._replace(image=np.where(folded[..., None], view.image * shade[..., None], view.image).astype("f4"))


@pytest.mark.parametrize("known", [False, True])
def test_misplaced_skin_is_not_covered_where_the_colour_of_hair_is_known(known):
    """The strands of the cap tell it."""
    vertices, faces = ball()
    height, none = heights(), np.zeros(len(faces), bool)
    scalp = (height > CAP + 0.3) & known
    found = covered_faces(list(misplaced_stripes(views())), faces, vertices, scalp, none, none)
    folded, hung_over = np.abs(height + 0.3) < 0.15, (height > CAP + 0.1) & (height < CAP + 0.3)
    assert found.texture[folded].mean() > 0.03
    assert (found.covered[folded].mean() > 0.9) == (not known)
    if known:
        assert found.covered[folded].mean() < 0.02
    assert found.covered[hung_over].mean() > 0.95


def test_images_without_the_mesh_tell_nothing():
    found = find([])
    assert not found.covered.any() and not found.texture.any() and np.isnan(found.colour).all()


def test_quantiles_of_histograms_are_those_of_the_values():
    rng = np.random.default_rng(0)
    values = rng.random((5, 4000)) ** np.arange(1, 6)[:, None]
    histograms = np.stack([np.histogram(row, 64, (0, 1))[0] for row in values]).astype(np.uint32)
    for share in (0.1, 0.5, 0.75):
        np.testing.assert_allclose(
            surface_cells.quantiles(histograms, share), np.quantile(values, share, axis=1), atol=1 / 64
        )
    assert np.isnan(surface_cells.quantiles(np.zeros((1, 64), np.uint32), 0.5)).all()


def test_cells_divide_triangles_into_parts_of_equal_area():
    """Over a large triangle that fills the image, each of its n^2 cells has about as many pixels."""
    from carigs.capture import Camera

    corners = np.array([[-2.0, -2, 1], [2, -2, 1], [0, 2, 1]])
    faces = np.array([[0, 2, 1]])
    camera = Camera(np.eye(4), 100.0, 100.0, 200.0, 200.0, 400, 400)
    seen, n = compute_visibility(corners, faces, camera), 4
    ones = np.ones(1, np.int32)
    cells = surface_cells.cell_image(
        seen.face, seen.fragments.barycentric, seen.inverse_depth, seen.depth_planes,
        np.ones(seen.face.shape, np.float32), np.ones(1, bool), 0 * ones, 0 * ones, n * ones, 0.5, 0.01,
    )  # fmt: skip
    count = np.bincount(cells[cells >= 0], minlength=n * n)
    assert len(count) == n * n
    np.testing.assert_allclose(count, (cells >= 0).sum() / n**2, rtol=0.1)


@pytest.mark.parametrize("angle", [0, 40, 74, 77, 89, 91, 106, 180])
@pytest.mark.parametrize("middle", [(0.0, 0.0, 1.0), (0.3, -0.4, 0.5)])
def test_a_face_faces_the_camera_up_to_a_limit_of_its_angle(angle, middle):
    """The normal is the direction to the camera, turned by the angle; 75.5 degrees have a cosine of 0.25."""
    middle, turned = np.array(middle), np.deg2rad(angle)
    toward = -middle / np.linalg.norm(middle)
    across = np.cross(toward, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    normal = np.cos(turned) * toward + np.sin(turned) * across
    u, v = np.cross(normal, [1.0, 0.0, 0.0]), np.cross(normal, np.cross(normal, [1.0, 0.0, 0.0]))
    corners = middle + 0.1 * np.array([u, -0.5 * u + v, -0.5 * u - v])
    facing = surface_cells.facing_faces(corners, np.array([[0, 1, 2], [0, 2, 1]], np.int32), 0.25)
    assert facing.tolist() == [np.cos(turned) > 0.25, -np.cos(turned) > 0.25]


@pytest.mark.parametrize(("share", "level", "covers"), [(1, 0.05, True), (0.3, 0.05, False), (1, None, False)])
def test_a_scalp_in_the_colour_of_smooth_black_hair_is_covered(share, level, covers):
    """No strand shows there. A dark spot on a bald head is none, and neither is skin that is a little darker."""
    vertices, faces = ball()
    centre = vertices[faces].mean(axis=1)
    scalp = centre[:, 1] > CAP * RADIUS
    azimuth = np.arctan2(centre[:, 0], centre[:, 2]) % (2 * np.pi)
    painted = scalp & (azimuth < 2 * np.pi * share)
    seen = []
    for view in views(hair=False):
        face, image = view.visibility.face, view.image.copy()
        on = (face >= 0) & painted[face]
        image[on] = 0.8 * image[on] if level is None else level
        seen.append(view._replace(image=image))
    nothing = np.zeros(len(faces), bool)
    covered = covered_faces(seen, faces, vertices, scalp, nothing, nothing).covered
    inside = painted & (centre[:, 1] > (CAP + 0.15) * RADIUS) & (centre[:, 1] < 0.75 * RADIUS)
    assert covered[inside].mean() > 0.97 if covers else covered.mean() < 0.1
