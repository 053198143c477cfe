"""The gallery of the exaggeration, on the procedural head."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from carigs.capture.images import read_rgb
from carigs.errors import InputError
from carigs.toy import head_model
from evaluation.benchmarks import surface_gallery


def test_every_mesh_gets_a_sheet_of_the_presets(tmp_path, monkeypatch):
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.vertices[:, 1] *= 1.5
    ball.export(tmp_path / "egg.obj")
    monkeypatch.setattr(sys, "argv", ["surface_gallery", str(tmp_path), str(tmp_path / "egg.obj")])
    surface_gallery.main()
    sheet = read_rgb(tmp_path / "surface_egg.png")
    assert sheet.shape[1] == surface_gallery.WIDTH
    rows = np.array_split(sheet.min(axis=2), 3)
    assert all((row < 0.9).mean() > 0.1 for row in rows)  # natural and two presets


def test_a_missing_mesh_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["surface_gallery", str(tmp_path), str(tmp_path / "none.obj")])
    with pytest.raises(InputError, match=r"none\.obj: no such mesh"):
        surface_gallery.main()


@pytest.mark.slow
def test_lids_are_drawn_for_every_transfer(tmp_path):
    model = head_model()
    names = ("eyeBlink_L", "eyeBlink_R", *model.expression_names[2:])
    model = replace(model, expression_names=names)  # any two blendshapes stand for the lids
    surface_gallery.draw_lids(tmp_path / "lids.png", model)
    assert read_rgb(tmp_path / "lids.png").shape[1] == surface_gallery.WIDTH
