"""The motion of the triangles that carry teeth and the body: solids."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from surfaces import sphere

from carigs.errors import InputError
from carigs.mouth import Jaw
from carigs.splat.rig.mesh_gradient import differentiable_face_motion
from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.solid_motion import Solid, SolidMotion, solid_motion_of

VERTICES, FACES = sphere(3, 0.1)
RIG = build_rig(VERTICES, FACES)
HEIGHT = VERTICES[FACES].mean(axis=1)[:, 1]
SOLIDS = np.select([HEIGHT > 0.06, HEIGHT < -0.05, np.abs(HEIGHT) < 0.01], [*Solid][1:], Solid.NONE).astype(np.uint8)
MOTION = SolidMotion(RIG, SOLIDS)


def wobbled(seed: int = 0, amount: float = 0.003) -> np.ndarray:
    return VERTICES + amount * np.random.default_rng(seed).standard_normal(VERTICES.shape)


def test_a_rigid_motion_stays_exact():
    posed = Rotation.from_rotvec([0.4, -0.2, 0.7]).apply(VERTICES) + np.array([0.1, 0.2, -0.3])
    plain, solid = face_motion(RIG, posed), face_motion(RIG, posed, None, MOTION.apply)
    np.testing.assert_allclose(solid.records, plain.records, atol=2e-6)


def test_each_solid_moves_as_a_solid_and_all_else_is_kept():
    """Distances between points that triangles of one solid carry do not change; nor does the mean centre move."""
    plain, solid = face_motion(RIG, wobbled()), face_motion(RIG, wobbled(), None, MOTION.apply)
    area = np.linalg.norm(np.cross(*(VERTICES[FACES[:, k]] - VERTICES[FACES[:, 0]] for k in (1, 2))), axis=1)
    for solid_number in [*Solid][1:]:
        mine = SOLIDS == solid_number
        rest = VERTICES[FACES[mine]].mean(axis=1) + np.array([0.0, 0.0, 0.05])
        offset = rest - VERTICES[FACES[mine]].mean(axis=1)
        carried = solid.centre[mine] + np.einsum("nij,nj->ni", solid.jacobian[mine], offset)
        before = np.linalg.norm(rest[:, None] - rest, axis=2)
        np.testing.assert_allclose(np.linalg.norm(carried[:, None] - carried, axis=2), before, atol=1e-6)
        weight = area[mine] / area[mine].sum()
        np.testing.assert_allclose(weight @ solid.centre[mine], weight @ plain.centre[mine], atol=1e-7)
    other = SOLIDS == Solid.NONE
    for name in ("centre", "rotation", "stretch"):
        np.testing.assert_array_equal(getattr(solid, name)[other], getattr(plain, name)[other])


def test_it_is_the_rigid_motion_of_a_jaw_that_turns():
    posed, turn = VERTICES.copy(), Rotation.from_rotvec([0.3, 0.0, 0.0])
    low = VERTICES[:, 1] < -0.03
    posed[low] = turn.apply(VERTICES[low]) + np.array([0.0, -0.01, 0.02])
    motion = face_motion(RIG, posed, None, MOTION.apply)
    lower = SOLIDS == Solid.LOWER_JAW
    np.testing.assert_allclose(
        motion.rotation[lower], np.broadcast_to(turn.as_matrix(), (lower.sum(), 3, 3)), atol=1e-6
    )


def test_gradients_of_translations_are_those_of_finite_differences():
    """A jaw whose triangles share no vertex with others is translated: its rotation is constant."""
    weights = torch.from_numpy(np.random.default_rng(1).standard_normal((len(FACES), 3)))
    inside = np.isin(FACES, np.unique(FACES[SOLIDS == Solid.LOWER_JAW])).any(axis=1)
    weights[torch.from_numpy(inside & (SOLIDS != Solid.LOWER_JAW))] = 0
    moving = torch.zeros(len(VERTICES), 1, dtype=torch.float64)
    moving[np.unique(FACES[SOLIDS == Solid.LOWER_JAW])] = 1

    def value(offset: torch.Tensor) -> torch.Tensor:
        posed = torch.from_numpy(wobbled()) + moving * offset
        return (differentiable_face_motion(RIG, posed, None, MOTION).records[:, 6:9].double() * weights).sum()

    offset = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    value(offset).backward()
    for k in range(3):
        step = torch.eye(3, dtype=torch.float64)[k] * 1e-3
        slope = float(value(step).detach() - value(-step).detach()) / 2e-3
        assert float(offset.grad[k]) == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_the_motion_of_a_file_is_the_one_that_was_written(tmp_path):
    read = solid_motion_of(MOTION.as_arrays(), RIG, tmp_path / "avatar.npz")
    np.testing.assert_array_equal(
        face_motion(RIG, wobbled(), None, read.apply).records, face_motion(RIG, wobbled(), None, MOTION.apply).records
    )
    for broken in (np.full(len(FACES), 4, np.uint8), SOLIDS[1:], SOLIDS / 2):
        with pytest.raises(InputError, match=r"avatar\.npz.*solid_faces"):
            solid_motion_of({"solid_faces": broken}, RIG, tmp_path / "avatar.npz")


def test_the_numbers_of_the_jaws_are_those_of_the_mouth():
    assert [int(jaw) for jaw in Jaw] == [Solid.NONE, Solid.UPPER_JAW, Solid.LOWER_JAW]
