"""Every preset on every mesh, and lids under every transport, in clay: the pictures of docs/exaggeration.md.

python -m evaluation.figures.surface_gallery docs/images head.obj ... --head-model ict_model.npz
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from carigs.exaggeration import Exaggerator, transfer_blendshapes
from carigs.exaggeration.blendshape_transfer import TRANSFER_FACTORS
from carigs.head import HeadModel, HeadParameters, neutral
from carigs.mesh.triangle_mesh import size
from evaluation.benchmarks.surface import Mesh, read_heads
from evaluation.benchmarks.surface_accuracy import GAMMA, PRESETS, preset
from evaluation.figures.clay import clay_sheet

WIDTH = 660
"""Pixels of a sheet."""


def presets(file: Path, mesh: Mesh) -> None:
    """A sheet of the head and of each preset's caricature, brought back to the head's own size where it is not."""
    vertices, faces = mesh
    shown = {"natural": vertices}
    for name in PRESETS:
        moved = vertices + Exaggerator(vertices, faces, preset(name)).solve(GAMMA)
        growth = size(moved, faces) / size(vertices, faces)
        centre = moved.mean(axis=0)
        shown[f"{name} {GAMMA:g} (size x {growth:.2f})"] = vertices.mean(axis=0) + (moved - centre) / growth
    clay_sheet(file, shown, faces)
    shrink(file)


def lids(file: Path, model: HeadModel) -> None:
    """A sheet of the eyes under a full blink: the natural head, and its caricature with each transport."""
    head = neutral(model, HeadParameters(shape=np.pad(np.random.default_rng(1).normal(size=30), (0, 270))))
    columns = [model.expression_names.index(name) for name in ("eyeBlink_L", "eyeBlink_R")]
    blinks = model.shapedirs[:, :, 300:][:, :, columns].transpose(2, 0, 1).astype(np.float64)
    solver = Exaggerator(head, model.faces, preset("robust"))
    path = solver.path(GAMMA)
    shown = {"natural, eyes closed": head + blinks.sum(axis=0)}
    for transport in TRANSFER_FACTORS:
        solver.settings = replace(solver.settings, blendshape_transfer=transport)
        caricature = transfer_blendshapes(path, solver, blinks, np.arange(2)).at(GAMMA)
        moved = head + caricature.displacement
        shown[f"{GAMMA:g}, {transport}"] = moved + blinks.sum(axis=0) + caricature.blendshape_change(np.ones(2))
    faces = model.faces[model.vertex_region("eye_region", "left_eyeball", "right_eyeball")[model.faces].all(axis=1)]
    used, corners = np.unique(faces, return_inverse=True)
    clay_sheet(file, {name: vertices[used] for name, vertices in shown.items()}, corners.reshape(-1, 3))
    shrink(file)


def shrink(file: Path) -> None:
    """Bring a PNG to `WIDTH`."""
    image = cv2.imread(str(file))
    height = round(image.shape[0] * WIDTH / image.shape[1])
    image = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(file), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def main() -> None:
    """Write `surface_{mesh}.png` for each mesh, and `surface_lids.png`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--head-model", type=Path)
    given = parser.parse_args()
    heads = read_heads(given.meshes)
    model = HeadModel.load(given.head_model) if given.head_model else None
    for name, mesh in heads.items():
        presets(given.folder / f"surface_{name}.png", mesh)
    if model is not None:
        lids(given.folder / "surface_lids.png", model)


if __name__ == "__main__":
    main()
