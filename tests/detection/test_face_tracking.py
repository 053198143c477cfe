"""A face is followed, by networks that know where it is because it is drawn as three spots."""

import numpy as np
import pytest
from drawn_faces import ColourMesh, Told, drawn, landmarks

from carigs.detection.crop import Crop
from carigs.detection.face_networks import FaceNetworks
from carigs.detection.face_track import collect, listed
from carigs.detection.face_tracking import follow_face
from carigs.detection.mesh_indices import COUNT
from carigs.errors import CarigsError


def followed(images, told, far=()):
    return collect(follow_face(iter(images), FaceNetworks(Told(told), Told(list(far)), ColourMesh())))


@pytest.mark.parametrize("angle", [0, 0.4, -0.7])
def test_landmarks_are_where_the_face_is_however_it_is_turned(angle):
    face = Crop(150, 120, 90, angle)
    track = followed([drawn([face])], [[face]])
    assert np.abs(track.landmarks[0] - landmarks(face)).max() < 0.6
    assert track.faces.tolist() == [1] and not track.notes()


def test_the_largest_face_is_chosen_and_then_followed():
    one = [Crop(90, 120, 80, 0.0)] * 3
    other = [Crop(240, 120, size, 0.0) for size in (50, 75, 95)]
    images = [drawn([a, b]) for a, b in zip(one, other, strict=True)]
    track = followed(images, [[b, a] for a, b in zip(one, other, strict=True)])
    for found in track.landmarks:
        assert np.abs(found - landmarks(one[0])).max() < 1
    assert track.notes() == ["several faces, of which one is followed: 3 of 3 images (0-2)"]


def test_a_person_is_followed_who_passes_behind_another():
    """The other face hides that of the person, and is then where it was expected."""
    person = [Crop(100 + 20 * i, 120, 80, 0.0) for i in range(8)]
    other = [Crop(240 - 20 * i, 110, 85, 0.0) for i in range(8)]
    hidden = [abs(a.x - b.x) < 65 for a, b in zip(person, other, strict=True)]
    told = [[b] if hides else [a, b] for a, b, hides in zip(person, other, hidden, strict=True)]
    told[0] = [person[0]]
    images = [drawn(faces, pale=other[i] if i else None) for i, faces in enumerate(told)]
    track = followed(images, told)
    for found, face, hides in zip(track.landmarks, person, hidden, strict=True):
        assert hides or np.abs(found - landmarks(face)).max() < 5  # the faces' spots touch
    assert 2 <= sum(hidden) <= 4 and not hidden[-1]
    assert np.flatnonzero(track.jumped).tolist() == [hidden.index(True), hidden.index(True) + sum(hidden)]


def test_a_face_that_only_the_second_network_sees_must_be_certain():
    class Hidden(ColourMesh):
        def __call__(self, crop):
            return super().__call__(crop)._replace(presence=0.8)

    face = Crop(150, 120, 90, 0.0)
    networks = FaceNetworks(Told([[face], []]), Told([]), Hidden())
    assert collect(follow_face([drawn([face])] * 2, networks)).found.tolist() == [True, False]


def test_a_face_that_the_detector_loses_is_followed_from_where_it_was():
    faces = [Crop(100 + 6 * i, 120, 90, 0.05 * i) for i in range(5)]
    track = followed([drawn([face]) for face in faces], [[faces[0]]])
    for found, face in zip(track.landmarks, faces, strict=True):
        assert np.abs(found - landmarks(face)).max() < 0.8
    assert not track.notes()


def test_images_without_a_face_and_jumps_are_noted():
    first, second = Crop(80, 100, 80, 0.0), Crop(240, 140, 80, 0.0)
    nothing = drawn([])
    images = [nothing, drawn([first]), nothing, nothing, drawn([second])]
    track = followed(images, [[], [first], [], [], [second]])
    assert np.isnan(track.landmarks[[0, 2, 3]]).all() and track.presence.tolist() == [0, 1, 0, 0, 1]
    assert track.notes() == [
        "no face: 3 of 5 images (0, 2-3)",
        "the face jumps, as in a cut or to another person: 1 of 5 images (4)",
    ]


def test_the_second_detector_is_asked_where_the_first_finds_nothing():
    face = Crop(150, 120, 60, 0.0)
    assert followed([drawn([face])], [[]], [[face]]).found.tolist() == [True]


def test_a_detection_that_is_no_face_is_none():
    assert followed([drawn([])], [[Crop(100, 100, 50, 0.0)]]).found.tolist() == [False]


def test_one_image_at_a_time_is_taken():
    taken = []

    def images():
        for i in range(3):
            taken.append(i)
            yield drawn([Crop(150, 120, 90, 0.0)])

    results = follow_face(images(), FaceNetworks(Told([[Crop(150, 120, 90, 0.0)]] * 3), Told([]), ColourMesh()))
    assert next(results).face is not None and taken == [0]


def test_no_images_are_an_empty_track():
    track = collect([])
    assert track.landmarks.shape == (0, COUNT, 3) and track.notes() == [] and track.presence.shape == (0,)


@pytest.mark.parametrize(
    "image",
    [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3)), np.zeros((9, 9, 4), np.uint8), np.zeros((0, 9, 3), np.uint8)],
    ids=["grey", "float", "with alpha", "empty"],
)
def test_images_of_another_kind_are_refused(image):
    with pytest.raises(CarigsError, match=r"image 1 from 0: .* expected uint8"):
        followed([drawn([]), image], [[], []])


def test_images_are_named_as_runs():
    where = np.isin(np.arange(12), [1, 2, 3, 7, 9, 10])
    assert listed(where) == "1-3, 7, 9-10"
    assert listed(where, 2 * np.arange(12)) == "2-6, 14, 18-20"  # every second image was looked at
    assert listed(np.arange(100) % 2 == 0).endswith("14, ...")
    assert listed(~np.zeros(3, bool)) == "0-2" and listed(np.zeros(3, bool)) == listed(np.zeros(0, bool)) == ""
