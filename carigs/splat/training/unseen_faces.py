"""The parts of the head that no training frame shows, such as its back in a capture by one camera.

A training has no reason to keep the surfels there in order: they end as noise, or explain outlines from behind. After
the training, opaque discs on the mesh take their place, in the colours of the skin and of the scalp around.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.head.facial_regions import eye_and_brow_faces
from carigs.mesh.harmonic_faces import faces_beside, harmonic_faces
from carigs.raster import compute_visibility
from carigs.settings.regions import Regions
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels, flat_discs, from_arrays, to_arrays

FRAMES = 64
"""Training frames that are looked at."""
UNSEEN, WELL_SEEN = 0.2, 0.5
"""Largest cosine, over the frames, between the normal of a triangle and the direction to the camera: below the first,
the triangle counts as unseen; above the second, its colours are used elsewhere."""
ON_SKIN = 2.0
"""Distance from the middle of its triangle, in units of k, up to which a surfel lies on the skin; others are hair."""
OPAQUE, FILLED, SCALE = 0.5, 0.98, 0.7
"""Opacity of the surroundings from which on discs are drawn, opacity of the discs, and their standard deviation in
units of k."""


class SeenFaces(NamedTuple):
    """What training frames show of each triangle."""

    cosine: Float[np.ndarray, " f"]
    """Largest cosine between the normal and the direction to a camera that shows the triangle; -1 if none does."""
    matte: Float[np.ndarray, " f"]
    """Mean opacity of the foreground at its pixels, 0 without any: less than 1 where the matte is cut off."""


def seen_faces(capture: Capture, sequence: HeadSequence) -> SeenFaces:
    """Look at the triangles in training frames.

    Args:
        capture: The capture.
        sequence: The subject.

    Returns:
        What the frames show.
    """
    faces = sequence.rig.faces
    cosine, pixels, opaque = np.full(len(faces), -1.0), np.zeros(len(faces)), np.zeros(len(faces))
    for frame in evenly_spread(capture.split("train"), FRAMES):
        vertices, camera = sequence.posed(frame.timestep, 0.0), capture.camera(frame)
        face = compute_visibility(vertices, faces, camera).face
        inside = face >= 0
        pixels += np.bincount(face[inside], minlength=len(faces))
        opaque += np.bincount(face[inside], capture.foreground(frame)[inside], len(faces))
        shown = np.unique(face[inside])
        a, b, c = vertices[faces[shown]].swapaxes(0, 1)
        normal, view = np.cross(b - a, c - a), camera.centre - (a + b + c) / 3
        length = np.linalg.norm(normal, axis=1) * np.linalg.norm(view, axis=1)
        cosine[shown] = np.maximum(cosine[shown], np.einsum("nc,nc->n", normal, view) / np.maximum(length, 1e-12))
    return SeenFaces(cosine, opaque / np.maximum(pixels, 1))


def complete_unseen(surfels: Surfels, capture: Capture, sequence: HeadSequence, regions: Regions) -> Surfels:
    """Replace the surfels on the skin that no training frame shows.

    Eyes, lips and the inside of the mouth keep theirs: few frames show all of them.

    Args:
        surfels: Trained surfels.
        capture: The capture.
        sequence: The subject.
        regions: Regions of the head model.

    Returns:
        The surfels: the same where frames show the head.
    """
    head, rig = sequence.head, sequence.rig
    seen = seen_faces(capture, sequence)
    kept = head.face_region(*regions.mouth, *regions.eyeballs, "lips") | eye_and_brow_faces(head, head.v_template)
    unseen = (seen.cosine < UNSEEN) & ~kept
    source = (seen.cosine > WELL_SEEN) & ~kept
    if not unseen.any() or not source.any():
        return surfels
    beside, scalp = faces_beside(rig.faces), head.face_region(*regions.hair)
    colours, coloured = face_colours(surfels, len(rig.faces))
    coloured &= source & (seen.matte > OPAQUE)
    rgb = np.zeros_like(colours)
    for part in (scalp, ~scalp):  # hair is continued by hair, skin by skin
        inside = np.flatnonzero(part)
        rgb[inside] = harmonic_faces(colours[inside], coloured[inside], beside[inside][:, inside])
    opacity = harmonic_faces(seen.matte, source, beside)
    position = surfels.position.detach().numpy()
    replaced = unseen[surfels.binding] & (np.linalg.norm(position, axis=1) < ON_SKIN)
    drawn = np.flatnonzero(unseen & (opacity > OPAQUE))
    count = len(drawn)
    colour = rgb[drawn].clip(0.02, 0.98)
    discs = flat_discs(drawn, np.zeros((count, 3)), np.full(count, SCALE), FILLED, colour, surfels.sh_degree)
    trained, added = to_arrays(surfels), to_arrays(discs)
    return from_arrays(**{name: np.concatenate([values[~replaced], added[name]]) for name, values in trained.items()})


def face_colours(surfels: Surfels, faces: int) -> tuple[Float[np.ndarray, "f 3"], Bool[np.ndarray, " f"]]:
    """Mean colour of the surfels of each triangle, without what depends on the view.

    Args:
        surfels: Surfels; large and opaque ones count more.
        faces: Number of triangles.

    Returns:
        RGB, and which triangles have surfels.
    """
    opacity, log_scale, colour = (
        values.detach().numpy().astype(np.float64) for values in (surfels.opacity, surfels.log_scale, surfels.colour)
    )
    weight = np.minimum(np.exp(log_scale.sum(axis=1)), 1) / (1 + np.exp(-opacity))
    rgb = weight[:, None] * (0.5 + SH_BASE * colour).clip(0.02, 0.98)
    total = np.bincount(surfels.binding, weight, faces)
    sums = np.stack([np.bincount(surfels.binding, channel, faces) for channel in rgb.T], axis=1)
    return sums / np.maximum(total, 1e-12)[:, None], total > 1e-6
