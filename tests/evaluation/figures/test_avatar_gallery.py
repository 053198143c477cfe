"""The gallery of avatars."""

import numpy as np
import pytest
from avatars import ball_avatar
from PIL import Image

import carigs
from carigs.library import HeadAvatar
from evaluation.figures.avatar_gallery import gallery_images, gallery_poses, write_gallery

SIZE = 48


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


def test_each_image_is_a_cut_of_the_rendering(avatar):
    images, poses = gallery_images(avatar, SIZE), gallery_poses(avatar)
    assert list(images) == list(poses)
    for title, (controls, azimuth) in poses.items():
        (camera,) = carigs.orbit(avatar, 1, azimuth=azimuth, size=60)
        whole = avatar.render(camera, **controls)
        assert (images[title] == whole[6:54, 6:54]).all(), title
        assert images[title].shape == (SIZE, SIZE, 3)


def test_regions_that_the_head_lacks_are_left_out(avatar):
    titles = set(gallery_poses(avatar))
    assert ("nose alone" in titles) == ("nose" in avatar.regions)
    assert ("ears alone" in titles) == bool({"left_ear", "right_ear"} & set(avatar.regions))
    assert {"level 0", "level 0.25", "jaw opened"} <= titles


def test_a_row_for_each_avatar(avatar, tmp_path):
    sizes = []
    for names in (("one",), ("one", "two")):
        write_gallery(tmp_path / "gallery.png", dict.fromkeys(names, avatar), SIZE)
        sizes.append(np.asarray(Image.open(tmp_path / "gallery.png")).shape)
    (one, width, _), (two, same, _) = sizes
    assert width == same
    assert two - one == pytest.approx(SIZE, abs=1)
