"""A dataset that ends below the chin: what fades, and what stays as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from carigs.capture import Capture, read_dataset
from carigs.capture.images import read_rgb8
from carigs.errors import InputError
from carigs.head import neutral, pose
from carigs.matting.cut_dataset import write_cut_dataset
from carigs.readers.images import read_pixels
from carigs.settings.capture import Toy
from carigs.toy import write_capture

ROUNDING = 1.01 / 255


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Capture:
    folder = tmp_path_factory.mktemp("whole") / "toy"
    folder.mkdir()
    toy = Toy(width=64, height=80, cameras=3, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=200)
    write_capture(folder, toy)
    return read_dataset(folder, folder / "head_model.npz", background=1.0)


def cut_copy(capture: Capture, folder: Path) -> Capture:
    write_cut_dataset(folder, capture)
    return read_dataset(folder, folder / "head_model.npz", background=capture.background)


@pytest.fixture(scope="module")
def cut(whole, tmp_path_factory) -> Capture:
    return cut_copy(whole, tmp_path_factory.mktemp("cut") / "toy")


def pairs(whole: Capture, cut: Capture):
    assert [(f.timestep, f.camera, f.split) for f in cut.frames] == [
        (f.timestep, f.camera, f.split) for f in whole.frames
    ]
    return list(zip(whole.frames, cut.frames, strict=True))


def test_frames_fade_to_the_background_as_mattes_fade_to_zero(whole, cut):
    """The pixel at a height above the cut keeps its share s of the matte and of the difference to the background."""
    lost = 0
    for old, new in pairs(whole, cut):
        before, after = whole.mask(old), cut.mask(new)
        some = before > 0.2
        share = after[some] / before[some]
        assert after[some].max() > 0.9 and (after <= before + ROUNDING).all()
        difference = (whole.image(old) - 1)[some] * share[:, None] - (cut.image(new) - 1)[some]
        assert np.abs(difference).max() < 6 * ROUNDING  # the share is known to 1 / (255 * 0.2)
        lost += (after < 0.5 * before)[some].sum()
    assert lost > 100


def test_the_face_stays_and_the_lower_end_goes(whole, cut):
    model = whole.model
    rest = neutral(model, whole.parameters(whole.frames[0].timestep))
    lowest, lips = rest[:, 1] < rest[:, 1].min() + 0.01, model.vertex_region("lips")
    for old, new in pairs(whole, cut):
        camera, posed = whole.camera(old), pose(model, whole.parameters(old.timestep))
        for vertices, kept in ((lips, True), (lowest, False)):
            column, row = camera.project(posed[vertices])[0].astype(int).T
            inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
            before, after = (c.mask(f)[row[inside], column[inside]] for c, f in ((whole, old), (cut, new)))
            # The head may hide the far side of the neck.
            assert np.abs(after - before).max() < ROUNDING if kept else np.median(after) == 0


def test_heads_and_cameras_are_the_same(whole, cut):
    for old, new in pairs(whole, cut):
        np.testing.assert_allclose(whole.camera(old).camera_from_world, cut.camera(new).camera_from_world, atol=1e-9)
        np.testing.assert_array_equal(
            pose(whole.model, whole.parameters(old.timestep)), pose(cut.model, cut.parameters(new.timestep))
        )


def test_of_images_with_an_alpha_channel_the_opacity_fades_alone(whole, cut, tmp_path):
    """Such a copy shows the same as one with separate mattes."""
    (tmp_path / "images").mkdir()
    frames = []
    for frame in (whole.split(split)[0] for split in ("train", "test")):
        image, matte = read_rgb8(whole.root / frame.image), (255 * whole.mask(frame)).astype(np.uint8)
        name = f"images/{frame.name}.png"
        cv2.imwrite(str(tmp_path / name), np.dstack([image[..., ::-1], matte]))
        frames.append(replace(frame, image=name, mask=name, parameters=str(whole.root / frame.parameters)))
    found = cut_copy(replace(whole, root=tmp_path, frames=tuple(frames)), tmp_path / "cut")
    for old, new in pairs(replace(whole, frames=tuple(frames)), found):
        stored, copied = read_pixels(tmp_path / old.image), read_pixels(found.root / new.image)
        np.testing.assert_array_equal(copied[..., :3], stored[..., :3])
        [same] = [frame for frame in cut.frames if frame.name == new.name]
        assert np.abs(found.mask(new) - cut.mask(same)).max() < 2 * ROUNDING


def test_a_head_model_that_does_not_say_where_its_chin_is(whole, tmp_path):
    model = replace(whole.model, landmarks68=None, regions={})
    model.save(tmp_path / "head_model.npz")
    with pytest.raises(InputError, match=r"lips.*capture\.body=keep"):
        write_cut_dataset(tmp_path / "cut", replace(whole, head_model=tmp_path / "head_model.npz"))
