"""Directions of the strands that the stage `hair` has found, drawn over a frame of each subject.

Example:
    python -m evaluation.figures.strand_directions strands.png toy=results/toy/toy ict_s7=results/ict/ict_s7
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Capture
from carigs.hair import FoundHair, load_hair
from carigs.hair.views import HairView, read_views, scalp_motion
from carigs.hair.visible_voxels import DENSE, visible_voxels
from carigs.head import neutral
from evaluation.command_line import run
from evaluation.figures.sheet import write_sheet

SCALE, HEIGHT = 3, 900
"""Enlargement of a frame before lines are drawn, and the height of an image in the sheet in pixels."""
FADED = 0.65
"""Share of white in the frame below the lines."""
CONFIDENT = 0.6
"""Confidence from which on a direction counts as known, see `Strands`."""
KNOWN, DOUBTFUL = (0.0, 0.32, 0.8), (0.55, 0.55, 0.55)
LEGEND = {"direction of strands": KNOWN, "views agree less": DOUBTFUL}
LENGTH, CELL = 0.008, 0.005
"""Length of a line in metres, and of the edge of the squares on the image that have a line each."""
SHIFT = 4
"""Bits of the fraction in OpenCV's coordinates."""


def image_segments(
    found: FoundHair, view: HairView, transform: Float[np.ndarray, "3 4"]
) -> tuple[Float[np.ndarray, "n 2 2"], Float32[np.ndarray, " n"]]:
    """Project the strands of dense hair that a view shows: in each square of the image the one known best.

    Args:
        found: The hair.
        view: A frame.
        transform: Camera axes from the axes of the canonical head (`scalp_motion`).

    Returns:
        Both ends (x, y) of a line in pixels, centres at +0.5, and its confidence.
    """
    seen, camera = visible_voxels(found.volume, view, transform), view.visibility.camera
    cells = np.stack([seen.row, seen.column], axis=1) // max(round(CELL / view.visibility.pixel_size), 1)
    best_first = np.argsort(-found.strands.confidence[seen.voxel], kind="stable")
    best_first = best_first[found.volume.opacity[seen.voxel[best_first]] >= DENSE]
    shown = seen.voxel[best_first[np.unique(cells[best_first], axis=0, return_index=True)[1]]]
    half = 0.5 * LENGTH * found.strands.direction[shown, None] * np.array([[-1], [1]])
    x, y, z = np.moveaxis((found.volume.centres[shown, None] + half) @ transform[:, :3].T + transform[:, 3], -1, 0)
    pixels = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=-1)
    return pixels, found.strands.confidence[shown]


def strand_images(
    capture: Capture, found: FoundHair, regions: tuple[str, ...] = ("scalp",)
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w 3"]]:
    """Draw the strands over the training frame that shows most of the hair.

    Args:
        capture: The capture.
        found: Its hair.
        regions: Regions of the head model with hair.

    Returns:
        The frame, and the frame with the strands.
    """
    canonical = neutral(capture.model, capture.parameters(capture.split("train")[0].timestep))
    carrier = np.unique(capture.model.faces[capture.model.face_region(*regions)])
    views = read_views(capture)
    motions = [scalp_motion(canonical, view.visibility, carrier) for view in views]
    counts = [
        len(visible_voxels(found.volume, view, motion).voxel) for view, motion in zip(views, motions, strict=True)
    ]
    best = int(np.argmax(counts))
    view, (segments, confidence) = views[best], image_segments(found, views[best], motions[best])
    frame = cv2.resize(view.image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_CUBIC).clip(0, 1)
    drawn = np.rint(255 * (FADED + (1 - FADED) * frame)).astype(np.uint8)
    points = np.rint((SCALE * segments - 0.5) * 2**SHIFT).astype(int)
    for i in np.argsort(confidence, kind="stable"):  # what is known lies on top
        colour = [255 * c for c in (KNOWN if confidence[i] >= CONFIDENT else DOUBTFUL)]
        cv2.line(drawn, *points[i], colour, 2, cv2.LINE_AA, SHIFT)
    return frame.astype(np.float32), drawn.astype(np.float32) / 255


def main() -> None:
    """Draw the strands of subjects from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="PNG to write")
    parser.add_argument("subjects", nargs="+", metavar="NAME=FOLDER", help="folder with capture.json and hair.npz")
    arguments = parser.parse_args()
    images = {}
    for name, _, folder in (text.partition("=") for text in arguments.subjects):
        capture = Capture.load(Path(folder) / "capture.json")
        images[name] = strand_images(capture, load_hair(Path(folder) / "hair.npz", len(capture.model.faces)))
    height = max(frame.shape[0] for frame, _ in images.values())
    write_sheet(
        arguments.file, [[image for pair in images.values() for image in _of_height(pair, height)]], rows=[""],
        columns=[title for name in images for title in (name, "strands")], title="Directions of strands",
        height=min(HEIGHT, height), legend=LEGEND,
    )  # fmt: skip


def _of_height(images: tuple[np.ndarray, ...], height: int) -> list[np.ndarray]:
    return [
        cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height), interpolation=cv2.INTER_AREA)
        for image in images
    ]


if __name__ == "__main__":
    run(main)
