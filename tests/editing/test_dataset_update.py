"""Which frame is edited when, what replaces it, and that a checkpoint holds all of it."""

import numpy as np
import pytest

from carigs.editing.dataset_update import DatasetUpdate
from carigs.editing.edit_steps import first_edit, last_edit, number_of_edits
from carigs.errors import InputError, SettingsError
from carigs.settings import Edit


def inverted(view):
    """An editor whose result says what it got."""
    return 1 - view.rendered


def update_of(capture, seed=0, editor=inverted, from_avatar=False, **settings):
    edit = Edit(**{"editor": "instruct_pix2pix", "every": 3, **settings})
    return DatasetUpdate(edit, capture, seed, from_avatar=from_avatar, editor=editor)


@pytest.mark.parametrize("from_avatar", [False, True])
@pytest.mark.parametrize("every", [1, 3, 10])
def test_views_are_edited_in_epochs_between_the_first_and_the_last_edit(capture, every, from_avatar):
    update, iterations = update_of(capture, every=every, from_avatar=from_avatar), 601
    due = {i: index for i in range(iterations) if (index := update.due(i, iterations)) is not None}
    first, last = (bound(iterations, from_avatar) for bound in (first_edit, last_edit))
    assert [*due] == [*range(first, last, every)]
    assert len(due) == number_of_edits(update.settings, iterations, from_avatar)
    assert (first, last) == ((0, 480) if from_avatar else (300, 540))
    frames, edited = len(update.frames), [*due.values()]
    for start in range(0, len(edited) - frames + 1, frames):
        assert sorted(edited[start : start + frames]) == [*range(frames)]
    if len(edited) >= 2 * frames:
        assert edited[:frames] != edited[frames : 2 * frames]
    other = update_of(capture, seed=1, every=every, from_avatar=from_avatar)
    assert [other.due(i, iterations) for i in due] != edited


def test_learning_rates_fall_once_before_the_edits_and_once_with_them(capture):
    progress = [update_of(capture).progress(i, 100) for i in range(100)]
    np.testing.assert_allclose(progress, [*np.linspace(0, 1, 50)] * 2)
    progress = [update_of(capture, from_avatar=True).progress(i, 100) for i in range(100)]
    np.testing.assert_allclose(progress, np.linspace(0, 1, 100))


def test_without_an_editor_there_are_no_edits():
    assert number_of_edits(Edit(), 1000) == 0


def test_the_edit_of_what_is_rendered_replaces_the_frame(capture, view):
    update, rendered = update_of(capture), np.full((96, 80, 3), 0.3, np.float32)
    update.update(7, 2, view(2).vertices, lambda frame: rendered)
    assert [*update.images] == [2]
    np.testing.assert_array_equal(update.images[2], np.uint8(round(0.7 * 255)))


def test_an_edit_is_confined_to_its_region(capture, view):
    update = update_of(capture, regions=("nose",))
    update.update(0, 0, view(0).vertices, lambda frame: np.zeros((96, 80, 3), np.float32))
    same = (update.images[0] == capture.image8(capture.split("train")[0])).all(axis=-1)
    white = (update.images[0] == 255).all(axis=-1)
    face = capture.model.face_region("nose")
    assert same.mean() > 0.5 and white.sum() > 20
    np.testing.assert_array_equal(update.frozen(None), ~face)
    kept = np.zeros(len(face), bool)
    kept[np.flatnonzero(face)[0]] = True
    np.testing.assert_array_equal(update.frozen(kept), ~face | kept)
    assert update_of(capture).frozen(None) is None


def test_a_view_that_shows_nothing_of_the_region_asks_no_editor(capture, view):
    def refuse(_view):
        raise AssertionError("it was asked")

    update = update_of(capture, editor=refuse, regions=("nose",))
    update.update(0, 0, view(0).vertices * [-1, 1, -1], refuse)
    assert not update.images


def test_each_edit_has_a_seed_of_its_own(capture, view):
    seeds = []

    def keep(one):
        seeds.append(one.seed)
        return one.captured

    update = update_of(capture, editor=keep)
    for i, index in ((0, 0), (3, 0), (0, 1)):
        update.update(i, index, view(index).vertices, lambda frame: np.zeros((96, 80, 3), np.float32))
    assert len({*seeds}) == 3


def test_the_state_comes_back_from_its_arrays(capture, view):
    update, restored = update_of(capture), update_of(capture)
    for index in (1, 3):
        image = np.random.default_rng(index).random((96, 80, 3)).astype(np.float32)
        update.update(index, index, view(index).vertices, lambda frame, image=image: image)
    arrays = update.as_arrays()
    restored.restore({**arrays, "surfel_position": np.zeros(3)})
    assert restored.images.keys() == update.images.keys()
    for index, image in update.images.items():
        np.testing.assert_array_equal(restored.images[index], image)
        assert restored.images[index].strides == image.strides  # the loss sums in the order of memory
    for broken in ({"edited_frame_99": arrays["edited_frame_1"]}, {"edited_frame_1": arrays["edited_frame_1"][:5]}):
        with pytest.raises(InputError, match="edited_frame_"):
            update_of(capture).restore(broken)


def test_an_editor_that_draws_needs_a_nose(capture):
    from dataclasses import replace

    from carigs.editing.editor import DRIFTS, make_editor

    for name, drift in DRIFTS.items():
        assert make_editor(Edit(editor=name), capture, 0).drift == drift
    without = replace(capture)
    without.__dict__["model"] = replace(capture.model, regions={})
    with pytest.raises(SettingsError, match=r"train\.edit\.editor=drawn_nose: the head model has no region nose"):
        make_editor(Edit(editor="drawn_nose"), without, 0)
