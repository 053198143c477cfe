"""The measures of tracked heads: zero for the truth in another place, and what is known for other heads."""

from dataclasses import replace

import numpy as np
import pytest

from carigs.detection.mesh_indices import LIP_GAPS
from carigs.head import flame_joints
from carigs.toy import head_model
from carigs.tracking.cameras import Cameras
from carigs.tracking.footage_tracking import FootageTrack
from carigs.tracking.solver.landmark_tracking import TrackedHead
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_recordings import filmed_toy, toy_subject
from evaluation.benchmarks.footage.scenes import talk
from evaluation.benchmarks.footage.tracked_heads import compared, mean_opening, measure

MODEL = head_model()
TRUTH = talk(MODEL, np.zeros(MODEL.num_identity), 64, Talk(seconds=2, fps=8))
KEPT = np.arange(len(TRUTH.parameters))


def track(parameters):
    """The truth's camera, and other parameters."""
    focal = np.array([2 * TRUTH.cameras[0][0].fx])
    cameras = Cameras(focal, np.full((1, 2), 32.0), np.array([[np.pi, 0, 0, 0, 0, 0.0]]))
    nothing = np.zeros((len(KEPT), 1, 0))
    head = TrackedHead(MODEL, parameters, cameras, 1.0, nothing, np.zeros((len(KEPT), 1, 0, 2)))
    return FootageTrack(KEPT, np.array([0]), ((),), np.zeros((len(KEPT), 1, 0, 2)), head, focal / 2)


def rows(parameters):
    return {row.quantity: row.value for row in compared(TRUTH, track(parameters), "case")}


def test_the_truth_has_no_error_wherever_the_world_is():
    moved = [replace(p, translation=p.translation + np.array([0.1, -0.2, 0.3])) for p in TRUTH.parameters]
    found = rows(moved)
    assert max(value for name, value in found.items() if "similarity" in name or "frame" in name) < 1e-3
    assert found["slope of the gap between lids"] == pytest.approx(1, abs=1e-6)
    assert found["slope of the gap between lips"] == pytest.approx(1, abs=1e-6)
    assert found["focal length over the true one"] == 2 and found["its first guess over the true one"] == 1


def test_one_similarity_leaves_the_depth_of_frames_and_one_of_each_frame_takes_it_out():
    depths = 0.01 * np.random.default_rng(2).normal(size=len(KEPT))
    depths -= depths.mean()
    found = rows(
        [
            replace(p, translation=p.translation + np.array([0, 0, z]))
            for p, z in zip(TRUTH.parameters, depths, strict=True)
        ]
    )
    assert found["face, one similarity"] == pytest.approx(1e3 * np.abs(depths).mean(), rel=0.1)
    assert found["face, one of each frame"] < 1e-3


def test_a_jaw_that_opens_half_as_far_has_half_the_slope():
    still = [
        replace(TRUTH.parameters[0], expression=np.zeros(100), joints=flame_joints(jaw=[a, 0, 0]))
        for a in np.linspace(0, 0.2, 9)
    ]
    truth = replace(TRUTH, parameters=still)
    half = replace(TRUTH, parameters=[replace(p, joints=0.5 * p.joints) for p in still])
    found, wanted = mean_opening(truth, half.vertices(), truth.vertices(), np.arange(9), LIP_GAPS)
    assert np.polyfit(wanted, found, 1)[0] == pytest.approx(0.5, abs=0.02)


def test_landmarks_that_lie_farther_along_the_lips_do_not_change_the_opening():
    heads = TRUTH.vertices()
    aside = heads + np.einsum(
        "tij,vj->tvi",
        TRUTH.world_from_head(),
        0.004 * (MODEL.v_template[:, 1:2] > MODEL.v_template[:, 1].mean()) * [[1.0, 0, 0]],
    )
    found, wanted = mean_opening(TRUTH, aside, heads, KEPT, LIP_GAPS)
    assert np.polyfit(wanted, found, 1)[0] == pytest.approx(1, abs=0.02)


@pytest.mark.slow
def test_a_small_clip_is_tracked():
    subject = toy_subject(supersampling=1, texture_size=128, hair_strands=100)
    filmed = filmed_toy(subject, "talk", Talk(seconds=2, fps=10), side=128)
    found = {(row.case, row.quantity): row.value for row in measure("talk", filmed, ["guessed"])}
    exact, network = (
        found[f"talk, {name}, focal length guessed", "face, one of each frame"]
        for name in ("exact landmarks", "landmarks of a network")
    )
    assert exact < 2 and exact < network
