"""The light of a capture: what it is fitted to."""

from pathlib import Path

import numpy as np
from miniature import write_ball

from carigs.capture import Capture
from carigs.capture.gaussian_avatars import read_dataset
from carigs.capture.images import write_png
from carigs.gtstar.capture_shading import fit_capture_shading
from carigs.head import pose
from carigs.raster import rasterize_mesh
from carigs.settings import Gtstar


def ball(folder: Path) -> Capture:
    return read_dataset(write_ball(folder), folder / "head_model.npz")


def paint(subject: Capture, faces: np.ndarray) -> None:
    """Show some triangles in another colour in all images."""
    for frame in subject.split("train"):
        vertices = pose(subject.model, subject.parameters(frame.timestep))
        shown = rasterize_mesh(vertices, subject.model.faces, subject.camera(frame)).face
        image = subject.image(frame).copy()
        image[(shown >= 0) & faces[shown]] = [0.9, 0.1, 0.05]
        write_png(subject.root / frame.image, image)


def test_what_covers_the_skin_has_no_part_in_its_light(tmp_path):
    """A scarf over one side, in any colour, leaves the light as it was if its triangles are known to be covered."""
    subject, painted = ball(tmp_path / "bare"), ball(tmp_path / "painted")
    x = subject.model.v_template[subject.model.faces, 0]
    clean, flags = x.min(axis=1) < 0, np.zeros(len(x), np.uint16)
    paint(painted, x.min(axis=1) > 0.03)  # no pixel of the skin beside mixes with it
    bare, scarf = (fit_capture_shading(Gtstar(), capture, flags, clean=clean) for capture in (subject, painted))
    np.testing.assert_array_equal(scarf.light, bare.light)
    naive = fit_capture_shading(Gtstar(), painted, flags)
    assert np.abs(naive.light - bare.light).max() > 0.1 * np.abs(bare.light).max()
