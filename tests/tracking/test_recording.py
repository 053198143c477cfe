"""What is unusual about footage."""

from dataclasses import replace

import numpy as np
from tracking.test_footage_tracking import recording

from carigs.tracking.recording import oddities


def test_ordinary_footage_has_no_oddities():
    assert oddities([recording(np.ones(12)), recording(np.ones(12), name="right.mp4")]) == []


def test_files_that_are_cut_off_and_other_people_are_named_once():
    odd = recording(np.ones(12))
    line = "me.mp4: 69 of 150 frames can be decoded"
    faces = replace(odd.faces, faces=np.array([2] * 5 + [1] * 7))
    odd = odd._replace(footage=replace(odd.footage, warnings=(line,)), faces=faces)
    assert oddities([odd]) == [line, "me.mp4: 5 of its images show more than one face; one of them is followed"]
    views = oddities([odd, odd])  # two views of one file
    assert views == [line, "me.mp4: 10 of its images show more than one face; one of them is followed"]
