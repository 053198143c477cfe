"""Semantic labels of the frames."""

import cv2
import numpy as np
import pytest
from hair.hairy_ball import ball, views
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.errors import InputError, SettingsError
from carigs.hair import find_hair
from carigs.hair.covered_faces import covered_faces
from carigs.hair.labels import MIN_VIEWS, labelled_as_covered, read_covering
from carigs.hair.views import read_views
from carigs.settings import Hair


def write(file, labels):
    file.write_bytes(cv2.imencode(".png", np.asarray(labels))[1].tobytes())
    return file


def test_classes_are_read_and_scaled(tmp_path):
    labels = np.zeros((4, 6), np.uint8)
    labels[:2, :3], labels[2:, 3:] = 17, 13
    file = write(tmp_path / "a.png", labels)
    assert read_covering(tmp_path / "missing.png", (17,), (4, 6)) is None
    # By default hair is 17; CelebAMask-HQ's list, where it is 13, has 17 for the neck.
    for classes, value in ((Hair().label_classes, 17), ((3, 13, 14, 15, 16, 18), 13)):
        np.testing.assert_array_equal(read_covering(file, classes, (4, 6)), labels == value)
    np.testing.assert_array_equal(read_covering(file, (17, 13), (8, 12)), np.kron(labels > 0, np.ones((2, 2), bool)))
    np.testing.assert_array_equal(read_covering(file, (17,), (2, 3)), [[True, False, False], [False] * 3])


@pytest.mark.parametrize(
    ("labels", "problem"),
    [
        (np.zeros((4, 6, 3), np.uint8), "no colours"),
        (np.zeros((4, 6), np.uint16), "8-bit"),
        (np.zeros((40, 40), np.uint8), "40 x 40 pixels; its frame has 60 x 40"),
    ],
)
def test_other_images_are_refused(tmp_path, labels, problem):
    file = write(tmp_path / "labels.png", labels)
    with pytest.raises(InputError, match=rf"labels\.png.*{problem}"):
        read_covering(file, (17,), (40, 60))


def test_triangles_take_the_vote_of_their_pixels():
    face = np.array([[0, 0, 1, 1], [0, 0, 1, -1]])
    covering = np.array([[True, True, False, True], [True, False, False, True]])
    np.testing.assert_array_equal(labelled_as_covered(3 * [(face, covering)], 3), [True, False, False])
    assert not labelled_as_covered(2 * [(face, covering)], 3).any()  # too few views


def test_labels_cover_features_that_the_texture_cannot_tell():
    """A band of a bald ball is labelled: it is covered, also where brows are, but not on eyeballs."""
    vertices, faces = ball()
    height = vertices[faces].mean(axis=1)[:, 1]
    band, none = (height > 0.03) & (height < 0.05), np.zeros(len(faces), bool)
    brows, eyeball = band & (vertices[faces].mean(axis=1)[:, 0] > 0.05), band & (vertices[faces][:, 0, 2] > 0.08)
    labelled = []
    for view in views(hair=False):
        face = view.visibility.face
        labelled.append(view._replace(covering=(face >= 0) & band[face]))
    assert not covered_faces(list(views(hair=False)), faces, vertices, none, none, none).covered.any()
    found = covered_faces(labelled, faces, vertices, none, eyeball, brows)
    np.testing.assert_array_equal(found.covered, band & ~eyeball)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    folder = write_ball(tmp_path_factory.mktemp("ball"))
    return read_dataset(folder, folder / "head_model.npz")


def test_labels_of_a_capture(subject, tmp_path):
    """Of a bald ball, hair is where labels say so; labels of some frames are enough."""
    plain = find_hair(Hair(), subject)
    views_of_ball = read_views(subject)
    low = subject.model.v_template[subject.model.faces].mean(axis=1)[:, 1] < 0
    frames = subject.split("train")
    assert len(views_of_ball) == len(frames)
    seen = np.zeros(len(low), int)
    for frame, view in list(zip(frames, views_of_ball, strict=True))[::2]:
        face = view.visibility.face
        seen[np.unique(face[face >= 0])] += 1
        write(tmp_path / f"{frame.name}.png", np.where((face >= 0) & low[face], 200, 0).astype(np.uint8))
    found = find_hair(Hair(labels=str(tmp_path), label_classes=(200,)), subject)
    assert not plain.covered.any()
    often = seen >= MIN_VIEWS
    assert often.sum() > 200
    assert (found.covered[often] == low[often]).mean() > 0.99  # edges of triangles at the boundary


def test_a_folder_without_labels_is_an_error(subject, tmp_path):
    with pytest.raises(InputError, match=r"no labels of training frames, such as \d{5}_\d\d\.png"):
        find_hair(Hair(labels=str(tmp_path)), subject)


def test_settings_are_checked():
    Hair(labels="x", label_classes=(0, 255))
    for wrong in ({"label_classes": (256,)}, {"label_classes": (-1,)}):
        with pytest.raises(SettingsError, match=r"hair\.label_"):
            Hair(**wrong)
