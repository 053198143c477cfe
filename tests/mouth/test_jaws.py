"""The triangles that carry teeth, on the procedural head, whose teeth are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from surfaces import sphere

from carigs.head import HeadParameters, flame_joints, neutral, pose
from carigs.head.surface_points import SurfacePoints
from carigs.mouth import Jaw, find_jaws, lip_line
from carigs.splat.rig.rig import build_rig, polar_decomposition
from carigs.splat.rig.solid_motion import SolidMotion
from carigs.toy.look.teeth import attach_teeth, build_teeth
from carigs.toy.rig import expressions
from carigs.toy.rig.head_model import head_model

MODEL = head_model()
SHAPE = np.zeros(MODEL.num_identity)


def parameters(jaw=0.0, turn=(0.0, 0.0, 0.0), **actions) -> HeadParameters:
    expression = np.zeros(MODEL.num_expressions)
    for name, value in actions.items():
        expression[expressions.NAMES.index(name)] = value
    return HeadParameters(np.array([0.1, 0, 0.2]), np.array(turn), flame_joints(jaw=[jaw, 0.0, 0.0]), SHAPE, expression)


FRAMES = [
    parameters(), parameters(jaw=0.3), parameters(jaw=0.15, turn=(0.2, -0.4, 0.1)), parameters(jaw_open=0.8),
    parameters(mouth_smile_left=1.0, mouth_smile_right=1.0, jaw=0.1), parameters(mouth_pucker=1.0),
    parameters(jaw=0.2, upper_lip_up_left=1.0, lower_lip_down_right=1.0),
]  # fmt: skip
REST = neutral(MODEL, FRAMES[0])
POSED = [pose(MODEL, frame) for frame in FRAMES]
LINE = lip_line(MODEL, REST)


@pytest.fixture(scope="module")
def jaws() -> np.ndarray:
    return find_jaws(MODEL, REST, POSED, LINE)


def test_the_upper_jaw_is_above_the_lower_one_inside_the_mouth(jaws):
    centres = REST[MODEL.faces].mean(axis=1)
    for jaw, side in ((Jaw.UPPER, 1), (Jaw.LOWER, -1)):
        mine = centres[jaws == jaw]
        assert len(mine) >= 6
        assert (side * LINE.height(mine)).min() > 0
        assert LINE.depth(mine).min() > 0
        assert np.linalg.norm(mine - LINE.middle, axis=1).max() < 1.6 * LINE.width


def test_the_jaws_carry_the_true_teeth(jaws):
    """The teeth of the procedural head turn with head and jaw. The jaw opens by two centimetres.

    The roof of its mouth stretches a little as the jaw opens; expressions of the lips move both sides, which is left
    out here.
    """
    vertices, _, _, upper = build_teeth()
    with_teeth = attach_teeth(MODEL, (1e-3 * vertices).astype(np.float32), upper)
    rest = neutral(with_teeth, FRAMES[0])[len(REST) :]
    rig = build_rig(REST, MODEL.faces)
    motion, moved = SolidMotion(rig, jaws), 0.0
    for frame, posed in list(zip(FRAMES, POSED, strict=True))[:4]:
        centre, rotation, stretch, _ = polar_decomposition(rig, posed)
        motion.apply(centre, rotation, stretch)
        true = pose(with_teeth, frame)[len(REST) :]
        for jaw, mine, tolerance in ((Jaw.UPPER, slice(0, upper), 1.2e-3), (Jaw.LOWER, slice(upper, None), 0.2e-3)):
            f = int(np.flatnonzero(jaws == jaw)[0])
            carried = (rest[mine] - REST[MODEL.faces[f]].mean(axis=0)) @ rotation[f].T + centre[f]
            assert np.linalg.norm(carried - true[mine], axis=1).mean() < tolerance
        moved = max(moved, float(np.linalg.norm(true - rest - frame.translation, axis=1).max()))
    assert moved > 0.02


def test_a_head_without_an_inside_of_the_mouth_has_no_jaws():
    """On a ball whose lips are vertices of its front, rays from within see the backs of triangles alone."""
    vertices, faces = sphere(3, 0.1)
    lips = np.array([[x, y, 0.09] for x, y in ((-0.02, 0), (-0.01, 0.005), (0, 0.005), (0.01, 0.005), (0.02, 0),
                                               (0.01, -0.005), (0, -0.005), (-0.01, -0.005))])  # fmt: skip
    nearest = np.linalg.norm(vertices[:, None] - lips, axis=2).argmin(axis=0)
    landmarks = SurfacePoints.at_vertices(np.concatenate([np.zeros(60, np.int64), nearest]))
    ball = replace(MODEL, faces=faces, landmarks68=landmarks)
    line = lip_line(ball, vertices)
    assert line is not None
    assert find_jaws(ball, vertices, [vertices], line) is None


def test_a_mouth_that_does_not_move_as_two_solids_has_no_jaws():
    """Displacements of half a centimetre, independent from vertex to vertex and from frame to frame."""
    rng = np.random.default_rng(0)
    shaken = [posed + 0.005 * rng.standard_normal(posed.shape) for posed in POSED]
    assert find_jaws(MODEL, REST, shaken, LINE) is None


def test_teeth_of_the_model_are_the_jaws():
    teeth = {"teeth_upper": np.flatnonzero(REST[:, 1] > 0.05), "teeth_lower": np.flatnonzero(REST[:, 1] < -0.1)}
    model = replace(MODEL, regions={**MODEL.regions, **teeth})
    found = find_jaws(model, REST, POSED, LINE)
    np.testing.assert_array_equal(found == Jaw.UPPER, model.face_region("teeth_upper"))
    np.testing.assert_array_equal(found == Jaw.LOWER, model.face_region("teeth_lower"))


def test_a_rigid_motion_of_all_frames_changes_nothing(jaws):
    turn = Rotation.from_rotvec([0.3, 1.0, -0.4])
    turned = [turn.apply(posed) + np.array([1.0, -2.0, 3.0]) for posed in POSED]
    np.testing.assert_array_equal(find_jaws(MODEL, REST, turned, LINE), jaws)


def test_the_line_of_the_lips_needs_landmarks_in_their_order():
    assert lip_line(replace(MODEL, landmarks68=None), REST) is None
    assert lip_line(MODEL, REST * [-1, 1, 1]) is None
    assert LINE.height(LINE.points) == pytest.approx(0) and LINE.depth(LINE.points) == pytest.approx(0)
