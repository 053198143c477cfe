"""Trusted pixels of warped frames, on a ball whose colour is its rest position: the true caricature is known."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.frame_index import GroundTruth
from carigs.capture.images import write_png
from carigs.exaggeration.gamma_path import straight_path
from carigs.gtstar import face_mask_flags
from carigs.gtstar.mask_flags import MaskFlag
from carigs.hair import find_hair
from carigs.head import neutral, pose
from carigs.raster import rasterize_mesh
from carigs.settings import Gtstar, Hair, Regions
from evaluation.benchmarks.trusted_pixels import skin_regions, warped_pixels

FLAGS = ("newly_visible", "occluded", "outside_image", "outside_mesh", "covered")
SETTINGS = Gtstar(relight="none", regions=Regions(hair=("scalp",)))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    write_ball(folder)
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    caricature = straight_path(rest, capture.model.faces, rest * [0.2, 0, 0], 0.25).at(0.25)
    images = {}
    for frame in capture.split("test"):
        vertices = pose(capture.model, capture.parameters(frame.timestep), caricature)
        hit = rasterize_mesh(vertices, capture.model.faces, capture.camera(frame))
        albedo = 0.5 + 4 * capture.model.v_template
        colours = np.einsum("hwc,hwcx->hwx", hit.barycentric, albedo[capture.model.faces[hit.face]])
        images[frame.timestep, frame.camera] = folder / f"truth_{frame.name}.png"
        write_png(images[frame.timestep, frame.camera], np.where(hit.face[..., None] >= 0, colours, 1.0))
    return capture, caricature, GroundTruth(None, images, {})


def test_warps_of_a_known_surface_are_right_where_they_are_trusted(scene):
    capture, caricature, truth = scene
    regions = {"ball": np.ones(len(capture.model.faces), bool)}
    pixels = warped_pixels(SETTINGS, FLAGS, capture, caricature, truth, None, regions)["ball"]
    assert pixels.kept.mean() > 0.7
    assert -10 * np.log10(pixels.squared_error[pixels.kept].mean()) > 30
    assert pixels.wrong[pixels.kept].mean() < 0.02  # on the outline of small images


@pytest.mark.slow
def test_pixels_of_covered_triangles_are_left_out(scene):
    capture, caricature, truth = scene
    covered = capture.model.v_template[capture.model.faces].mean(axis=1)[:, 1] > 0
    hair = replace(find_hair(Hair(), capture), covered=covered)
    regions = {"covered": covered, "other": ~covered}
    with_hair, without = (
        warped_pixels(SETTINGS, FLAGS, capture, caricature, truth, known, regions) for known in (hair, None)
    )
    flagged = (face_mask_flags(capture.model, SETTINGS, covered) & MaskFlag.COVERED) > 0
    assert with_hair["covered"].kept.mean() <= 1 - flagged[covered].mean() + 0.1
    assert without["covered"].kept.mean() > 0.6
    np.testing.assert_array_equal(with_hair["other"].kept, without["other"].kept)


def test_the_bare_neck_is_what_nothing_covers(scene):
    capture = scene[0]
    neck = capture.model.face_region("neck")
    covered = np.zeros(len(neck), bool)
    covered[np.flatnonzero(neck)[::2]] = True
    regions = skin_regions(capture, covered)
    np.testing.assert_array_equal(regions["bare neck"], neck & ~covered)
