"""Where the squared error of an avatar at level 0 is, on held-out frames and on frames of the training.

Regions do not overlap: a pixel belongs to the first that holds it.

Example:
    python -m evaluation.benchmarks.error_shares shares.csv results/toy/toy/capture.json AVATAR.npz
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.head import neutral, pose
from carigs.head.facial_regions import brow_faces, lid_faces
from carigs.raster import rasterize_mesh
from carigs.splat.avatar import Avatar, load_avatar
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.benchmarks.measurement.toy_training import in_eight_bits
from evaluation.command_line import csv_parser, run
from evaluation.metrics.image_quality import psnr_of_errors, squared_error
from evaluation.metrics.regions import SurfaceRegions, image_regions, surface_regions

OUTLINE = 3
"""Width of the outline of the eyeballs in pixels."""


class ErrorShares:
    """Regions of a subject, and the errors of an avatar in them.

    Args:
        capture: The capture.
        avatar: The avatar.
    """

    def __init__(self, capture: Capture, avatar: Avatar) -> None:
        self.capture, self.avatar = capture, avatar
        model, rest = capture.model, neutral(capture.model, capture.parameters(capture.frames[0].timestep))
        self.surface: SurfaceRegions = surface_regions(model, rest)
        brows = brow_faces(model, rest)
        self.faces = {
            "eyeballs": model.face_region("left_eyeball", "right_eyeball"),
            "lids": lid_faces(model, rest),
            "lips": model.face_region("lips"),
            "brows": np.zeros(len(model.faces), bool) if brows is None else brows,
            "hair over the scalp": model.face_region("scalp"),
        }

    def regions(self, frame: Frame) -> dict[str, Bool[np.ndarray, "h w"]]:
        """Assign the pixels of a frame.

        Args:
            frame: The frame.

        Returns:
            Pixels by region; those of none are left out.
        """
        capture, model = self.capture, self.capture.model
        camera, vertices = capture.camera(frame), pose(model, capture.parameters(frame.timestep))
        seen = rasterize_mesh(vertices, model.faces, camera)
        mesh = seen.face >= 0
        found = image_regions(self.surface, vertices, seen, camera, capture.foreground(frame) > 0.5, band=2)
        on_mesh = {name: mesh & faces[seen.face] for name, faces in self.faces.items()}
        ball = on_mesh["eyeballs"].astype(np.uint8)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (OUTLINE, OUTLINE))
        outline = cv2.morphologyEx(ball, cv2.MORPH_GRADIENT, disc) > 0
        ordered = {
            "open mouth": found["mouth"] & ~on_mesh["lips"],
            "outline of the eyeballs": outline & mesh,
            **on_mesh,
            "hair beside the mesh": found["hair"] & ~mesh,
        }
        taken, regions = np.zeros_like(mesh), {}
        for name, inside in ordered.items():
            regions[name], taken = inside & ~taken, taken | inside
        return regions

    def errors(self, frames: Sequence[Frame]) -> dict[str, Float[np.ndarray, " n"]]:
        """Squared errors of the rendered frames.

        Args:
            frames: The frames.

        Returns:
            Errors of the pixels of each region, with all pixels as `full`.
        """
        found: dict[str, list[np.ndarray]] = {}
        for frame in frames:
            image = in_eight_bits(self.avatar.render(frame.timestep, 0.0, self.capture.camera(frame)))
            error = squared_error(image, self.capture.image(frame)).mean(axis=2)
            for name, inside in {"full": np.ones_like(error, bool), **self.regions(frame)}.items():
                found.setdefault(name, []).append(error[inside])
        return {name: np.concatenate(parts) for name, parts in found.items()}


def measure(capture: Capture, avatar: Avatar) -> Iterator[Measurement]:
    """Measure all held-out frames, and as many of the training, evenly spread.

    Args:
        capture: The capture.
        avatar: The avatar.

    Yields:
        For each region its share of the pixels, its share of the squared error, and the PSNR of its pixels; references
        are those of frames of the training.
    """
    shares, test, train = ErrorShares(capture, avatar), capture.split("test"), capture.split("train")
    held_out, trained = shares.errors(test), shares.errors(evenly_spread(train, len(test)))
    for name, errors in held_out.items():
        if not errors.size or not trained[name].size:
            continue
        both = [(of[name], of["full"]) for of in (held_out, trained)]
        yield Measurement(name, "share of the pixels", "1", *(part.size / full.size for part, full in both))
        yield Measurement(name, "share of the squared error", "1", *(part.sum() / full.sum() for part, full in both))
        yield Measurement(name, "PSNR", "dB", *(psnr_of_errors(part) for part, _ in both))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("capture", type=Path)
    parser.add_argument("avatar", type=Path)
    task = parser.parse_args()
    write_measurements(task.rows, measure(Capture.load(task.capture), load_avatar(task.avatar)))


if __name__ == "__main__":
    run(main)
