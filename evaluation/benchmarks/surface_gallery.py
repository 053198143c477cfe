"""Renderings of the exaggeration's presets and of blendshape transfer: the pictures of docs/exaggeration.md.

Example:
    python -m evaluation.benchmarks.surface_gallery docs/images head.obj ... --head-model ict_model.npz
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2

from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from carigs.mesh.triangle_mesh import size
from evaluation.benchmarks.exaggeration.surface_accuracy import (
    GAMMA,
    PRESETS,
    blink_by_transfer,
    full_blink,
    preset,
    random_person,
)
from evaluation.benchmarks.surface import Mesh, parse_heads
from evaluation.command_line import run
from evaluation.figures.clay import clay_sheet

WIDTH = 660
"""Width of a sheet in pixels."""


def draw_presets(file: Path, mesh: Mesh) -> None:
    """Draw a head and the caricature of each preset, scaled back to the size of the head.

    Args:
        file: PNG file to write.
        mesh: The head.
    """
    vertices, faces = mesh
    sheet = {"natural": vertices}
    for name in PRESETS:
        moved = vertices + Exaggerator(vertices, faces, preset(name)).solve(GAMMA)
        growth = size(moved, faces) / size(vertices, faces)
        centre = moved.mean(axis=0)
        sheet[f"{name} {GAMMA:g} (size x {growth:.2f})"] = vertices.mean(axis=0) + (moved - centre) / growth
    clay_sheet(file, sheet, faces)
    _shrink(file)


def draw_lids(file: Path, model: HeadModel) -> None:
    """Draw the eyes of a random person under a full blink: natural, and the caricature with each blendshape transfer.

    Args:
        file: PNG file to write.
        model: Head model with blendshapes eyeBlink.
    """
    head = random_person(model, seed=1)
    sheet = {"natural, eyes closed": head + full_blink(model).sum(axis=0)}
    for transfer, _, closed in blink_by_transfer(head, model, preset("robust")):
        sheet[f"{GAMMA:g}, {transfer}"] = closed
    region = model.vertex_region("eye_region", "left_eyeball", "right_eyeball")
    clay_sheet(file, sheet, model.faces[region[model.faces].all(axis=1)])
    _shrink(file)


def _shrink(file: Path) -> None:
    """Scale a PNG to `WIDTH`."""
    image = cv2.imread(str(file))
    height = round(image.shape[0] * WIDTH / image.shape[1])
    image = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(file), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def main() -> None:
    """Write `surface_{mesh}.png` for each mesh, and `surface_lids.png`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder to write to")
    arguments, heads, model = parse_heads(parser)
    for name, mesh in heads.items():
        draw_presets(arguments.folder / f"surface_{name}.png", mesh)
    if model is not None:
        draw_lids(arguments.folder / "surface_lids.png", model)


if __name__ == "__main__":
    run(main)
