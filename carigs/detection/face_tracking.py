"""Landmarks of one face in the images of a camera, followed over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt8

from carigs.detection.attention_mesh import FaceInCrop
from carigs.detection.crop import Crop, around, sample, to_image, turned_around
from carigs.detection.face_detector import EYES, SAME_FACE, Face, overlaps
from carigs.detection.face_networks import FaceNetworks, Mesh
from carigs.detection.likeness import SAME, Acquaintance, differences, face_colours
from carigs.detection.mesh_indices import LEFT_EYE, MIRRORED, RIGHT_EYE
from carigs.errors import CarigsError

SEARCH_MARGIN = 1.5
"""Size of a crop in that of the box around the face, as MediaPipe has it."""
FINAL_MARGINS = (1.3, 1.5, 1.7)
"""The same, of the last crops, whose landmarks are averaged. Smaller ones have more pixels for lids and lips, and in
larger ones the network follows a mouth that is wide open."""
SEARCHES = 2
"""Crops that only say where the last one lies. From two on, the landmarks do not depend on where the first one lay."""
LEAST_PRESENCE = 0.5
"""Probability of a face below which there is none."""
CERTAIN_PRESENCE = 0.95
"""The same where the detector finds none: before a hand over the whole face, the network still sees one, at 0.5 to 0.9;
in views from the side, where the detector fails first, it is certain."""
MOST_FACES = 4
"""Of the largest faces of an image, those that are looked at."""
FAR_JUMP = 0.5
"""Movement of the eyes between two images that is a jump, in lengths of the face."""


class FoundFace(NamedTuple):
    """The face of an image."""

    landmarks: Float32[np.ndarray, "p 3"]
    """x, y in pixels of the image (pixel centres at +0.5), and z in the same unit, smaller nearer to the camera."""
    presence: float
    """Probability that these are those of a face."""
    box: Float32[np.ndarray, "4"]
    """Left, top, right, bottom of the landmarks."""
    colours: Float32[np.ndarray, " k"]
    """By which it is compared with other faces (`carigs.detection.likeness`)."""


class ImageResult(NamedTuple):
    """What was found in an image."""

    face: FoundFace | None
    faces: int
    """Number of faces that the detector found."""
    jumped: bool
    """Whether the face was elsewhere in the image before, or looked otherwise: a cut, or another person."""


def follow_face(images: Iterable[UInt8[np.ndarray, "h w 3"]], networks: FaceNetworks) -> Iterator[ImageResult]:
    """Find the landmarks of one person: the largest face, and then those that look like it.

    Every image is searched for faces. Where the detector finds none, as in views from the side, the search begins where
    the face was before. If no face looks like that of the person, the nearest to where it was is taken, or the largest:
    light changes, and after a cut there may be somebody else. One image is in memory at a time.

    Args:
        images: RGB values, in the order of time.
        networks: The networks.

    Yields:
        The result of each image.

    Raises:
        CarigsError: If an image has other values than RGB from 0 to 255.
    """
    person, last = Acquaintance(), None
    size: tuple[int, ...] = ()
    for number, image in enumerate(images):
        _check(image, number)
        if image.shape != size:
            last, size = None, image.shape
        faces = networks.near(image) or networks.far(image)
        least = LEAST_PRESENCE if faces else CERTAIN_PRESENCE
        seen = (_look(image, crop, networks.mesh, least) for crop in _starts(faces, last))
        found = _best_known(filter(None, seen), person)
        jumped = found is not None and last is not None and _jumps(last, found)
        yield ImageResult(found, len(faces), jumped)
        last = found or last


def _check(image: np.ndarray, number: int) -> None:
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        problem = f"{image.dtype} values in the shape {image.shape}, expected uint8 in (height, width, 3)"
        raise CarigsError(f"image {number} from 0: {problem}")


def _starts(faces: list[Face], last: FoundFace | None) -> Iterator[Crop]:
    """Where to look for the face, the likeliest place first."""
    if last is not None and faces:
        shared = overlaps(last.box, np.array([face.box for face in faces]))
        if shared.max() >= SAME_FACE:
            yield _of_detection(faces[int(shared.argmax())])
    if last is not None:
        yield _of_landmarks(last.landmarks).scaled(SEARCH_MARGIN)
    yield from (_of_detection(face) for face in sorted(faces, key=_area, reverse=True)[:MOST_FACES])


def _of_detection(face: Face) -> Crop:
    return around(face.box, *(face.points[eye] for eye in EYES)).scaled(SEARCH_MARGIN)


def _of_landmarks(landmarks: Float[np.ndarray, "p 3"]) -> Crop:
    return turned_around(landmarks[:, :2], landmarks[LEFT_EYE[0], :2], landmarks[RIGHT_EYE[0], :2])


def _area(face: Face) -> float:
    return float(np.prod(face.box[2:] - face.box[:2]))


def _best_known(faces: Iterator[FoundFace], person: Acquaintance) -> FoundFace | None:
    """The first face of the person, else the first face; no other one is looked at if the first is the person's."""
    looked_at = []
    for face in faces:
        if person.recognises(face.colours):
            return face
        looked_at.append(face)
    return looked_at[0] if looked_at else None


def _look(image: UInt8[np.ndarray, "h w 3"], crop: Crop, mesh: Mesh, least: float) -> FoundFace | None:
    """The landmarks of the face near a crop; None if its probability is too low."""
    for _ in range(SEARCHES):
        if crop.size < 1:
            return None
        found = mesh(sample(image, crop, mesh.side))
        if found.presence < least:
            return None
        crop = _of_landmarks(to_image(found.points, crop, mesh.side)).scaled(SEARCH_MARGIN)
    crops = [crop.scaled(margin / SEARCH_MARGIN) for margin in FINAL_MARGINS]
    pixels = [sample(image, crop, mesh.side) for crop in crops]
    views = [with_mirror_image(crop, mesh) for crop in pixels]
    presence = min(view.presence for view in views)
    if presence < least:
        return None
    found = [to_image(view.points, crop, mesh.side) for view, crop in zip(views, crops, strict=True)]
    landmarks = np.mean(found, axis=0).astype(np.float32)
    box = np.concatenate([landmarks[:, :2].min(axis=0), landmarks[:, :2].max(axis=0)])
    return FoundFace(landmarks, presence, box, face_colours(pixels[0], views[0].points))


def with_mirror_image(crop: UInt8[np.ndarray, "s s 3"], mesh: Mesh) -> FaceInCrop:
    """Landmarks as the mean of those of a crop and of its mirror image, whose errors are other ones.

    Args:
        crop: The crop.
        mesh: The network.

    Returns:
        The means, and the lower probability.
    """
    plain, mirrored = mesh(crop), mesh(np.ascontiguousarray(crop[:, ::-1]))
    back = mirrored.points[list(MIRRORED)] * (-1, 1, 1) + (mesh.side, 0, 0)
    return FaceInCrop((plain.points + back) / 2, min(plain.presence, mirrored.presence))


def _jumps(before: FoundFace, after: FoundFace) -> bool:
    """Whether a face is somewhere else than the one before, or looks otherwise."""
    differs = float(differences(before.colours[None], after.colours[None])[0, 0])
    return _movement(before, after) > FAR_JUMP or differs > SAME


def _movement(before: FoundFace, after: FoundFace) -> float:
    """How far the eyes moved, in lengths of the face, and by how much it grew or shrank, as a share of itself."""
    eyes = [face.landmarks[[LEFT_EYE[0], RIGHT_EYE[0]], :2].mean(axis=0) for face in (before, after)]
    lengths = [float(np.max(face.box[2:] - face.box[:2])) for face in (before, after)]
    return max(float(np.linalg.norm(eyes[1] - eyes[0])), abs(lengths[1] - lengths[0])) / max(min(lengths), 1.0)
