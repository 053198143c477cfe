"""The contact sheet shows the worst frames first, and the outline lies around the mesh."""

from itertools import chain

import numpy as np
import pytest
from tracking.recordings import COUNT, recording

from carigs.tracking.judgement.contact_sheet import COLUMNS, LINE, OUTLINE, SIDE, Overlay, contact_sheet, frames_to_show

FACES = np.array([[0, 1, 2], [0, 2, 3]])


def square(low: float, high: float) -> np.ndarray:
    return np.array([[low, low], [high, low], [high, high], [low, high]], float)


def overlay(**changes) -> Overlay:
    values = {
        "image": np.full((200, 300, 3), 90, np.uint8),
        "vertices": square(50, 150),
        "landmarks": np.array([[100.0, 100], [np.nan, np.nan]]),
        "fitted": np.array([[110.0, 100], [120, 120]]),
    }
    return Overlay(**(values | changes))


def test_worst_frames_are_the_worst_but_not_neighbours():
    errors = np.ones(COUNT)
    errors[[100, 101, 102, 300]] = 9, 10, 9, 8
    worst, typical = frames_to_show(recording(errors={"lips": errors}))
    assert worst[:2] == [101, 300] and len(worst) == 4 and not set(worst) & set(typical)
    assert np.ptp(typical) > 0.8 * COUNT


def test_frames_that_were_left_out_are_not_shown():
    errors, gone = np.ones(COUNT), np.arange(COUNT) < 490
    errors[gone] = np.nan
    worst, typical = frames_to_show(
        recording(errors={"lips": errors}, left_out=tuple("no face" if g else "" for g in gone))
    )
    assert min(worst + typical) >= 490 and len(worst) + len(typical) == 10


def test_the_outline_lies_where_the_mesh_is():
    frames = recording()
    shown = [*chain(*frames_to_show(frames))]
    sheet = contact_sheet(frames, dict.fromkeys(shown, overlay()), FACES, "a title")
    assert sheet.shape == (3 * LINE + 3 * (SIDE + LINE), COLUMNS * SIDE, 3)
    cell = sheet[2 * LINE : 2 * LINE + SIDE, :SIDE].astype(int)
    rows, columns = np.nonzero(np.abs(cell - OUTLINE).sum(axis=2) < 60)
    edge = SIDE * 0.12 / 1.24
    for values in (rows, columns):
        assert values.min() == pytest.approx(edge, abs=1.5) and values.max() == pytest.approx(SIDE - edge, abs=1.5)


def test_what_lies_outside_the_image_is_white():
    frames = recording()
    shown = [*chain(*frames_to_show(frames))]
    cut = overlay(vertices=square(-60, 40))
    sheet = contact_sheet(frames, dict.fromkeys(shown, cut), FACES)
    cell = sheet[LINE : LINE + SIDE, :SIDE]
    assert (cell[5, 5] == 255).all() and (cell[-5, -5] == 90).all()
