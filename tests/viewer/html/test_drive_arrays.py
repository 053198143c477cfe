"""Sliders and clips of the page: sums of columns are the head before its joints turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from avatars import ball_sequence
from viewer.html.unpacking import unpacked

from carigs.exaggeration.gamma_path import GammaPath
from carigs.head import HeadParameters
from carigs.head.posing import unposed_frames
from carigs.viewer.html.drive_arrays import PageClip, drive_arrays
from carigs.viewer.html.light_arrays import TOLERANCE, light_arrays, light_factors
from carigs.viewer.html.packed_arrays import deflated


@pytest.fixture(scope="module")
def sequence():
    """The ball with two expressions, of which the first changes along the path, pose correctives, and names."""
    sequence = ball_sequence(lit=True)
    path, rng = sequence.path, np.random.default_rng(0)
    head = sequence.head
    shapes = head.shapedirs.copy()
    shapes[:, :, 301] = 0.01 * rng.normal(size=head.v_template.shape)
    corrective = (0.003 * rng.normal(size=head.posedirs.shape)).astype(np.float32)
    sequence.head = replace(head, shapedirs=shapes, posedirs=corrective, expression_names=("jawOpen", "mouthSmile"))
    changes = 0.01 * rng.normal(size=(len(path.levels) - 1, 1, *path.neutral.shape)).astype(np.float32)
    sequence.path = GammaPath(
        path.levels, path.displacements, path.faces, path.neutral, columns=np.array([0]), changes=changes
    )
    return sequence


def frames(count: int) -> list[HeadParameters]:
    rng = np.random.default_rng(1)
    return [
        HeadParameters(
            translation=0.05 * rng.normal(size=3), rotation=0.3 * rng.normal(size=3),
            joints=0.2 * rng.normal(size=(4, 3)), expression=np.pad(rng.random(2), (0, 98)),
        )
        for _ in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("level", [0.0, 0.11, 0.25])
def test_a_frame_of_a_clip_is_the_head_before_its_joints_turn(sequence, level):
    clip = frames(4)
    header, packed = drive_arrays(sequence, 1, [PageClip("take", 25.0, clip)], None)
    arrays = unpacked(*deflated(packed))
    assert header["clips"] == [{"name": "take", "fps": 25.0, "frames": 4, "sound": False}]
    path, base = sequence.path, sequence.parameters[1]
    caricature = path.at(level) if level else None
    weights = path.weights(level)[1:]
    known, known_joints, known_turns = unposed_frames(sequence.head, [base], caricature)
    expected, joints, turns = unposed_frames(sequence.head, clip, caricature)
    features = (turns - known_turns)[:, 1:].reshape(4, -1)
    assert header["corrected"] == features.shape[1] == 36
    for t in range(4):
        amounts = np.concatenate([arrays["clip0_coefficients"][t], features[t]])
        n = header["columns"]
        assert len(amounts) == n
        rows = np.concatenate([weight * amounts for weight in weights])
        change = arrays["change_basis"] @ (rows @ arrays["change_coefficients"])
        found = known[0] + (arrays["column_basis"] @ amounts + change).reshape(-1, 3)
        assert np.abs(found - expected[t]).max() < 2e-4
        moved = known_joints[0] + (amounts @ arrays["column_joints"] + rows @ arrays["change_joints"]).reshape(-1, 3)
        assert np.abs(moved - joints[t]).max() < 2e-4
        vectors = np.concatenate([clip[t].rotation, clip[t].joints.ravel()])
        assert np.abs(arrays["clip0_vectors"][t] - vectors).max() < 3e-4
        assert np.abs(arrays["clip0_translations"][t] - clip[t].translation).max() < 6e-6


def test_sliders_are_those_of_actions_that_the_head_has(sequence):
    header, _ = drive_arrays(sequence, 0, [], None)
    assert [slider["name"] for slider in header["sliders"]] == ["jaw open", "smile"]
    assert [turning["name"] for turning in header["turning"]] == ["look left", "look down"]
    nameless = replace(sequence.head, expression_names=())
    sequence = replace(sequence, head=nameless)
    header, _ = drive_arrays(sequence, 0, [], None)
    assert [slider["name"] for slider in header["sliders"]] == ["expression 1", "expression 0"]
    assert header["turning"][0]["name"] == "jaw"


def test_captured_frames_as_a_clip_have_the_captured_light(sequence):
    """The light of a captured frame lies in the basis that the captured light has."""
    timesteps = [0, 1, 2]
    _, _, light = light_arrays(sequence, timesteps, {})
    clip = PageClip("again", 1.0, [sequence.parameters[t] for t in timesteps])
    _, packed = drive_arrays(sequence, 0, [clip], light)
    arrays = unpacked(*deflated(packed))
    assert arrays["clip0_light_frames"].ravel().tolist() == timesteps
    for row, shares in enumerate(arrays["clip0_light"]):
        found = light.mean + shares @ light.basis
        expected = light_factors(sequence, sequence.parameters[row % 3], light.ends[row // 3])
        assert np.sqrt(np.mean((found - expected) ** 2)) < 3 * TOLERANCE < np.ptp(expected) / 2
