"""Mask flags of a target's pixels, and their agreement with the flags of triangles."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import FRONTAL, ball_cameras, ball_model, picture, sheet
from scipy.ndimage import distance_transform_edt

from carigs.errors import SettingsError
from carigs.gtstar import MaskFlag, Target, face_mask_flags, flags_from_names, make_target, mask_flags
from carigs.gtstar.mask_flags import frame_hair
from carigs.head import HeadModel
from carigs.raster import compute_visibility
from carigs.settings import DEFAULT_MASK_FLAGS, Gtstar

BALD = replace(ball_model(), regions={})


def made(natural, caricature, model: HeadModel, camera, foreground=None, image=None, **changes) -> Target:
    ends = [compute_visibility(vertices, model.faces, camera) for vertices in (natural, caricature)]
    if foreground is None:
        foreground = (ends[0].face >= 0).astype(np.float32)
    settings = Gtstar(**{"supersampling": 1, **changes})
    image = picture(camera) if image is None else image
    return make_target(image, foreground, *ends, model, face_mask_flags(model, settings), settings)


def mesh_model(vertices: np.ndarray, faces: np.ndarray) -> HeadModel:
    """A head model of these triangles that nothing moves."""
    v = len(vertices)
    empty = {"shapedirs": (v, 3, 301), "posedirs": (v, 3, 36), "joint_regressor": (5, v), "weights": (v, 5)}
    arrays = {name: np.zeros(shape, np.float32) for name, shape in empty.items()}
    return replace(BALD, v_template=vertices.astype(np.float32), faces=faces, **arrays)


def ball() -> np.ndarray:
    return ball_model().v_template.astype(np.float64)


@pytest.mark.parametrize("supersampling", [1, 4, 8])
def test_level_zero_is_the_frame_and_is_valid_inside_the_mesh(supersampling):
    camera = ball_cameras()[1]
    image = np.random.default_rng(0).random((camera.height, camera.width, 3)).astype(np.float32)
    target = made(ball(), ball(), BALD, camera, image=image, supersampling=supersampling)
    on_mesh = target.caricature.face >= 0
    np.testing.assert_allclose(target.colour[on_mesh], image[on_mesh], atol=1e-6)
    np.testing.assert_array_equal(target.colour[~on_mesh], 1.0)
    assert not target.mask_flags[on_mesh].any()
    assert not (target.mask_flags[~dilated(~on_mesh)] & flags_from_names(DEFAULT_MASK_FLAGS).value).any()


def test_newly_visible_skin_is_found():
    """A flap hides part of the sheet in the frame and is gone in the caricature: exactly that part was hidden."""
    vertices, faces = sheet()
    flap, flap_faces = sheet(4, 0.1, 0.1)
    both = np.vstack([vertices, flap + np.array([0, 0, 0.1])])
    moved = np.vstack([vertices, flap + np.array([5.0, 0, 0.1])])
    model = mesh_model(both, np.vstack([faces, flap_faces + len(vertices)]))
    target = made(both, moved, model, FRONTAL, np.ones((48, 64), np.float32))
    natural = compute_visibility(both, model.faces, FRONTAL)
    hidden = (natural.face >= len(faces)) & (target.caricature.face >= 0)
    assert hidden.sum() > 80
    np.testing.assert_array_equal((target.mask_flags & MaskFlag.OCCLUDED.value) > 0, hidden)


def test_what_turns_towards_the_camera_is_newly_visible():
    vertices, faces = sheet(3)
    model = mesh_model(vertices, faces)
    target = made(vertices * [-1, 1, 1], vertices, model, FRONTAL)
    on_mesh = target.caricature.face >= 0
    assert on_mesh.any()
    assert ((target.mask_flags[on_mesh] & MaskFlag.NEWLY_VISIBLE.value) > 0).all()


def test_grazing_and_stretched_triangles_are_found():
    vertices, faces = sheet(3)
    model = mesh_model(vertices, faces)
    turn = np.radians(87)
    oblique = vertices @ np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [0, 0, 1.0]]) * [1, 1, -1]
    for natural, expected in ((oblique, MaskFlag.GRAZING | MaskFlag.STRETCHED), (vertices / 3, MaskFlag.STRETCHED)):
        target = made(natural, vertices, model, FRONTAL)
        flags = np.bitwise_or.reduce(target.mask_flags[target.caricature.face >= 0]) & (4 | 8)
        assert flags == expected.value


@pytest.mark.parametrize(("degrees", "grazes"), [(88.2, False), (87.7, False), (85.0, True), (60.0, True)])
def test_what_is_seen_as_obliquely_in_the_caricature_does_not_graze(degrees, grazes):
    """A sheet at 88 degrees in the frame, turned: only where its cosine grows by more than a quarter."""
    vertices, faces = sheet(3)
    model = mesh_model(vertices, faces)

    def turned(angle):
        cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        return vertices @ np.array([[cosine, 0, -sine], [0, 1, 0], [0, 0, 1.0]])

    target = made(turned(88.0), turned(degrees), model, FRONTAL)
    flags = target.mask_flags[target.caricature.face >= 0] & MaskFlag.GRAZING.value
    assert len(flags) > 0
    assert (flags > 0).all() == grazes and (flags > 0).any() == grazes


def test_what_comes_from_beyond_the_border_is_found():
    vertices, faces = sheet(3)
    model = mesh_model(vertices, faces)
    target = made(vertices + np.array([0.3, 0, 0]), vertices, model, FRONTAL)
    _, x = np.nonzero((target.mask_flags & MaskFlag.OUTSIDE_IMAGE.value) > 0)
    assert set(x) == set(range(34, 52))  # 30 pixels to the right of them the image ends


def test_background_is_where_nothing_is_and_where_skin_has_moved_away():
    """The shrunken ball leaves skin behind: background from the ring around the caricature on."""
    camera = ball_cameras()[1]
    target = made(ball(), 0.8 * ball(), BALD, camera)
    on_mesh = target.caricature.face >= 0
    outside = (target.mask_flags & MaskFlag.OUTSIDE_MESH.value) > 0
    np.testing.assert_array_equal(outside, ~on_mesh & dilated(on_mesh))
    assert target.mask_flags[0, 0] == 0


def test_hair_may_be_anywhere_within_its_length():
    """A tuft stands off the ball: no background near it or the scalp, and none where it stood but plain background."""
    model, camera = ball_model(), ball_cameras()[1]
    foreground = (compute_visibility(ball(), model.faces, camera).face >= 0).astype(np.float32)
    row, column = np.argwhere(foreground > 0)[0]
    assert row > 6, "room for the tuft above the ball"
    tuft = np.zeros_like(foreground, bool)
    tuft[row - 6 : row, column - 1 : column + 2] = True
    outside = {
        hairy: (made(ball(), 0.8 * ball(), model, camera, matte).mask_flags & MaskFlag.OUTSIDE_MESH.value) > 0
        for hairy, matte in ((True, np.maximum(foreground, tuft)), (False, foreground))
    }
    assert outside[True][tuft].all()
    assert (outside[True] | ~outside[False]).all() and outside[True].sum() > outside[False].sum() + tuft.sum()
    assert not outside[True][~dilated((foreground > 0) | tuft)].any()


def test_hair_may_be_as_far_away_as_it_sticks_out(monkeypatch):
    """Where the shrunken ball leaves foreground, that is unknown up to the length of the hair, and no further."""
    monkeypatch.setattr("carigs.gtstar.mask_flags.HAIR_DILATION", 0)
    model, camera = ball_model(), ball_cameras()[1]
    natural, caricature = (compute_visibility(scale * ball(), model.faces, camera) for scale in (1.0, 0.8))
    matte = (natural.face >= 0).astype(np.float32)
    row, column = np.argwhere(matte > 0)[0]
    matte[row - 6 : row, column - 1 : column + 2] = 1
    hair = frame_hair(natural, matte, face_mask_flags(model, Gtstar()))
    assert 4 <= hair.length <= 8
    target = made(ball(), 0.8 * ball(), model, camera, matte)
    scalp = model.face_region("scalp")[caricature.face] & (caricature.face >= 0)
    distance = distance_transform_edt(~(hair.mask.to_array() | scalp))
    left_behind = (matte > 0) & ~dilated(dilated(caricature.face >= 0))
    outside = (target.mask_flags & MaskFlag.OUTSIDE_MESH.value) > 0
    near, far = (left_behind & clear for clear in (distance < hair.length - 1, distance > hair.length + 1))
    assert (near & (distance > 2)).any() and far.any()
    assert outside[near].all() and not outside[far].any()


def test_where_the_scalp_carries_hair_is_no_background():
    """The caricature moves the ball to the right, and a tuft with it, over plain background."""

    class Tuft:
        def pixels(self, natural, caricature):
            shown = np.zeros(caricature.face.shape, bool)
            row = np.argwhere(caricature.face >= 0)[0, 0] - 4
            shown[row, int(np.argwhere(caricature.face >= 0)[:, 1].mean())] = True
            return shown

        def radius(self, seen):
            return 1

    model, camera = ball_model(), ball_cameras()[1]
    ends = [compute_visibility(vertices, model.faces, camera) for vertices in (ball(), ball() + np.array([0.03, 0, 0]))]
    foreground, flags = (ends[0].face >= 0).astype(np.float32), face_mask_flags(model, Gtstar())
    with_tuft, without = (
        make_target(picture(camera), foreground, *ends, model, flags, Gtstar(), 1.0, hair).mask_flags
        for hair in (Tuft(), None)
    )
    changed = with_tuft != without
    assert 5 <= changed.sum() <= 9 and (with_tuft[changed] == MaskFlag.OUTSIDE_MESH.value).all()
    assert changed[Tuft().pixels(*ends)].all()


def dilated(mask: np.ndarray) -> np.ndarray:
    """The mask and its four neighbours in each pixel's direction."""
    grown, padded = mask.copy(), np.pad(mask, 1)
    for dy, dx in ((0, 1), (2, 1), (1, 0), (1, 2)):
        grown |= padded[dy : dy + mask.shape[0], dx : dx + mask.shape[1]]
    return grown


@pytest.mark.parametrize("supersampling", [1, 2])
def test_a_pixel_has_all_flags_of_its_triangle(supersampling):
    """Hence a flag that freezes the surfels of a triangle also masks every pixel that shows it."""
    model, camera = ball_model(), ball_cameras()[2]
    target = made(ball(), ball() * [1.2, 1, 1], model, camera, supersampling=supersampling)
    face_flags = face_mask_flags(model, Gtstar())
    assert (face_flags == MaskFlag.HAIR.value).sum() > 20
    on_mesh = target.caricature.face >= 0
    expected = face_flags[target.caricature.face[on_mesh]]
    np.testing.assert_array_equal(target.mask_flags[on_mesh] & expected, expected)


def test_an_unknown_flag_is_named():
    with pytest.raises(SettingsError, match=r"freckles is not a mask flag.* occluded"):
        flags_from_names(["hair", "freckles"])


def test_lids_and_ears_are_flagged_by_region():
    """A triangle has the flag of a region if all its corners lie in it, and no other flag."""
    model = ball_model()
    left, right = (np.flatnonzero(sign * model.v_template[:, 0] > 0.05) for sign in (-1, 1))
    model = replace(model, regions={"left_eyelid": left, "right_ear": right})
    flags = face_mask_flags(model, Gtstar())
    for region, flag in ((left, MaskFlag.LIDS), (right, MaskFlag.EARS)):
        expected = np.isin(model.faces, region).all(axis=1)
        assert 0 < expected.sum() < len(expected)
        np.testing.assert_array_equal((flags & flag.value) > 0, expected)
    assert not (flags & ~np.uint16(MaskFlag.LIDS | MaskFlag.EARS)).any()


def test_hair_is_flagged_with_a_band_around_it(monkeypatch):
    """At level 0: the scalp, a tuft that sticks out of the mesh, and a band around both."""
    model, camera = ball_model(), ball_cameras()[1]
    visibility = compute_visibility(ball(), model.faces, camera)
    foreground = (visibility.face >= 0).astype(np.float32)
    row, column = np.argwhere(foreground > 0)[0]
    foreground[row - 6 : row, column - 1 : column + 2] = 1
    scalp = (visibility.face >= 0) & model.face_region("scalp")[visibility.face]
    tuft = np.zeros_like(scalp)
    tuft[row - 6 : row - 1, column - 1 : column + 2] = True
    for width in (0, 1, 3):
        monkeypatch.setattr(mask_flags, "HAIR_DILATION", width)
        target = made(ball(), ball(), model, camera, foreground)
        hair = (target.mask_flags & MaskFlag.HAIR.value) > 0
        expected = scalp | tuft
        for _ in range(width):
            expected = dilated(expected)
        on_mesh = visibility.face >= 0
        assert hair[on_mesh & expected].all()
        assert hair[on_mesh].sum() < on_mesh.sum() / 2
        if width:
            assert (hair & on_mesh & ~scalp).any()


@pytest.mark.parametrize("sign", [1, -1])
def test_a_triangle_that_turns_over_is_newly_visible_either_way(sign):
    vertices, faces = sheet(3)
    model, turned = mesh_model(vertices, faces), vertices * [-1, 1, 1]
    natural, caricature = (vertices, turned)[::sign]
    target = made(natural, caricature, model, FRONTAL)
    on_mesh = target.caricature.face >= 0
    assert on_mesh.any()
    assert ((target.mask_flags[on_mesh] & MaskFlag.NEWLY_VISIBLE.value) > 0).all()


def test_brows_are_flagged_where_the_model_says_where_they_are():
    model = ball_model()
    assert not (face_mask_flags(model, Gtstar()) & MaskFlag.BROWS.value).any()
    with_brows = replace(model, regions={**model.regions, "brows": np.flatnonzero(model.v_template[:, 2] > 0.06)})
    flagged = (face_mask_flags(with_brows, Gtstar()) & MaskFlag.BROWS.value) > 0
    corners = np.isin(model.faces, model.faces[with_brows.face_region("brows")])
    np.testing.assert_array_equal(flagged, corners.any(axis=1))
    assert 0 < with_brows.face_region("brows").sum() < flagged.sum() < len(flagged) / 2
