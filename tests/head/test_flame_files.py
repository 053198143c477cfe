"""FLAME's files: each generation's pickle, and regions and landmarks from the files beside it or by geometry."""

from __future__ import annotations

import pickle
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from chumpy_like import install, python2_pickle
from scipy.sparse import csc_matrix
from shared_data import DATA, needs_data

from carigs.errors import CarigsWarning, InputError
from carigs.head import HeadModel
from carigs.head.flame_files import EYEBALLS
from carigs.head.region_geometry import FacialPoints, geometric_regions
from carigs.head.teeth import FLAME_COUNTS, FLAME_WITH_TEETH_COUNTS, LOWER_LIP, UPPER_LIP
from carigs.mesh.triangle_mesh import face_areas
from carigs.toy.rig.head_model import head_model

CORNERS = {"left": 54, "right": 48}  # landmarks; left is the subject's left
BETWEEN_LIPS = [62, 66]


@cache
def flame_head() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Arrays of FLAME's counts on points of the procedural head, and which vertices that head has in each region."""
    toy, random = head_model(), np.random.default_rng(0)
    balls = {side: toy.regions[f"{side}_eyeball"] for side in ("left", "right")}
    skin = np.flatnonzero(~toy.vertex_region("left_eyeball", "right_eyeball"))
    ids = np.concatenate([random.choice(skin, EYEBALLS[0][0]), *(np.resize(balls[side], 546) for side in balls)])
    vertices = toy.v_template[ids].astype(np.float64)
    left, right = toy.landmarks68[list(CORNERS.values())].interpolate(toy.v_template)
    middle = toy.landmarks68[BETWEEN_LIPS].interpolate(toy.v_template).mean(axis=0)
    along = np.linspace(1, -1, 15)[:, None]
    line = middle + (left - right) / 2 * along + ((left + right) / 2 - middle) * along**2
    opening = np.array([0, 0.002, 0])
    vertices[list(UPPER_LIP)], vertices[list(LOWER_LIP)] = line + opening, line - opening
    moved = np.isin(np.arange(len(ids)), [*UPPER_LIP, *LOWER_LIP])
    expected = {name: toy.vertex_region(name)[ids] & ~moved for name in toy.regions}
    v = FLAME_COUNTS[0]
    regressor = np.zeros((5, v))
    regressor[:, :50] = random.dirichlet(np.ones(50), 5)
    shapedirs = np.zeros((v, 3, 302), np.float32)  # FLAME has 100 expressions; two are enough here
    shapedirs[:, :, [0, 299, 300, 301]] = 1e-3 * random.normal(size=(v, 3, 4))
    arrays = {
        "f": np.stack([random.permutation(v)[:3] for _ in range(FLAME_COUNTS[1])]).astype(np.uint32),
        "J_regressor": csc_matrix(regressor),
        "kintree_table": np.array([[2**32 - 1, 0, 1, 1, 1], [0, 1, 2, 3, 4]], np.uint32),
        "J": np.zeros((5, 3)),
        "weights": random.dirichlet(np.ones(5), v),
        "posedirs": 1e-3 * random.normal(size=(v, 3, 36)),
        "v_template": vertices,
        "shapedirs": shapedirs,
        "bs_style": "lbs",
        "bs_type": "lrotmin",
    }
    return arrays, expected


def arrays() -> dict[str, np.ndarray]:
    """Arrays of FLAME's counts."""
    return flame_head()[0]


def expected() -> dict[str, np.ndarray]:
    """Which vertices each region has."""
    return flame_head()[1]


def with_chumpy(chumpy) -> dict:
    """Arrays as FLAME 2020 and 2023 Open hold them: some are chumpy's."""
    return {
        **arrays(),
        **{name: chumpy.Ch(arrays()[name]) for name in ("v_template", "shapedirs", "posedirs", "weights")},
    }


@pytest.mark.parametrize("generation", ["2020", "2023, protocol 2", "2023, protocol 4", "2023 Open"])
def test_each_generation_is_read(generation, monkeypatch, tmp_path):
    open_arrays = with_chumpy(install(monkeypatch))
    content = {
        "2020": lambda: python2_pickle(open_arrays),
        "2023, protocol 2": lambda: python2_pickle(arrays()),
        "2023, protocol 4": lambda: pickle.dumps(arrays(), 4),
        "2023 Open": lambda: pickle.dumps(open_arrays, 5),
    }[generation]()
    (tmp_path / "flame.pkl").write_bytes(content)
    (tmp_path / "FLAME_masks.pkl").write_bytes(python2_pickle({"scalp": np.arange(10), "nose": np.arange(5)}))
    model = HeadModel.load(tmp_path / "flame.pkl")
    v = FLAME_COUNTS[0]
    assert len(model.v_template) == FLAME_WITH_TEETH_COUNTS[0]
    for name in ("v_template", "shapedirs", "posedirs", "weights"):
        np.testing.assert_array_equal(getattr(model, name)[:v], arrays()[name].astype(np.float32))
    np.testing.assert_allclose(model.joint_regressor[:, :v], arrays()["J_regressor"].toarray(), rtol=1e-6)
    np.testing.assert_array_equal(model.faces[: FLAME_COUNTS[1]], arrays()["f"])
    np.testing.assert_array_equal(model.parents, [-1, 0, 1, 1, 1])
    np.testing.assert_array_equal(model.regions["nose"], np.arange(5))  # the file's, and not by geometry
    assert {"left_eyelid", "right_eyelid", "brows", "lip_inside"} <= set(model.regions)


def shares(found: np.ndarray, expected: np.ndarray, weights: np.ndarray | float = 1.0) -> tuple[float, float]:
    """Share of what is expected that is found, and of what is found that is expected."""
    both = (weights * (found & expected)).sum()
    return both / (weights * expected).sum(), both / (weights * found).sum()


def test_without_a_file_of_regions_they_are_found_by_geometry_with_a_warning(tmp_path):
    (tmp_path / "flame.pkl").write_bytes(pickle.dumps(arrays()))
    with pytest.warns(CarigsWarning, match=r"flame\.pkl: no FLAME_masks.pkl, .* hair, lips, lids and ears are found"):
        model = HeadModel.load(tmp_path / "flame.pkl")
    for name in ("scalp", "face", "nose", "lips", "left_eyelid", "right_eyelid", "brows", "left_ear", "right_ear"):
        recall, precision = shares(model.vertex_region(name)[: FLAME_COUNTS[0]], expected()[name])
        assert recall > 0.7 and precision > 0.75, (name, recall, precision)
    recall, _ = shares(model.vertex_region("lip_inside", "lips")[: FLAME_COUNTS[0]], expected()["lip_inside"])
    assert recall > 0.7
    np.testing.assert_array_equal(model.regions["right_eyeball"], EYEBALLS[1])
    assert not np.isin(model.regions["teeth"], model.regions["lip_inside"]).any()


def test_the_warning_does_not_depend_on_how_the_file_is_named(tmp_path, monkeypatch):
    """Settings may name it by a relative path; the index of the capture has the absolute one."""
    monkeypatch.chdir(tmp_path)
    Path("flame.pkl").write_bytes(pickle.dumps(arrays()))
    texts = set()
    for file in (Path("flame.pkl"), tmp_path / "flame.pkl"):
        with pytest.warns(CarigsWarning) as caught:
            HeadModel.load(file)
        texts |= {str(warning.message) for warning in caught}
    assert len(texts) == 1


@pytest.mark.parametrize("unit", [1e3, 10.0, 1e-2])
def test_regions_do_not_depend_on_the_unit(unit, tmp_path):
    regions = []
    for scale in (1.0, unit):
        (tmp_path / "flame.pkl").write_bytes(pickle.dumps({**arrays(), "v_template": scale * arrays()["v_template"]}))
        with pytest.warns(CarigsWarning):
            regions.append(HeadModel.load(tmp_path / "flame.pkl").regions)
    for name, ids in regions[0].items():
        assert len(np.setxor1d(ids, regions[1][name])) <= 0.01 * len(ids) + 1, name  # rounding at the limits


def test_a_head_without_eyes_where_flame_has_them_says_so(tmp_path):
    vertices = np.random.default_rng(1).normal(size=arrays()["v_template"].shape)
    (tmp_path / "flame.pkl").write_bytes(pickle.dumps({**arrays(), "v_template": vertices}))
    with pytest.warns(CarigsWarning, match="hair and ears are not masked"):
        assert set(HeadModel.load(tmp_path / "flame.pkl").regions) == {"teeth", "teeth_upper", "teeth_lower"}


@needs_data
def test_the_rules_hold_for_a_head_that_they_were_not_drawn_on():
    """Regions of the mean head of ICT-FaceKit, which were drawn by hand on its mesh."""
    model = HeadModel.load(DATA / "ict_model.npz")
    left, right = model.landmarks68[list(CORNERS.values())].interpolate(model.v_template)
    middle = model.landmarks68[BETWEEN_LIPS].interpolate(model.v_template).mean(axis=0)
    points = FacialPoints(model.regions["left_eyeball"], model.regions["right_eyeball"], left, right, middle)
    skin = ~model.vertex_region("left_eyeball", "right_eyeball")
    found = geometric_regions(model.v_template.astype(float), model.faces, points, skin)
    least = {"scalp": (0.8, 0.9), "left_ear": (0.7, 0.55), "right_ear": (0.7, 0.55), "nose": (0.7, 0.5)}
    areas = face_areas(model.v_template.astype(float), model.faces)
    for name, (least_recall, least_precision) in least.items():
        is_found = np.isin(model.faces, found[name]).all(axis=1)
        recall, precision = shares(is_found, model.face_region(name), areas)
        assert recall > least_recall and precision > least_precision, (name, recall, precision)


# Texture masks and landmarks.


def write_uv_files(folder, rows: int = 64) -> np.ndarray:
    """Texture coordinates of the faces on a grid of texels, and a mask of every third face; returns those faces."""
    n = FLAME_COUNTS[1]
    side = int(np.ceil(np.sqrt(n)))
    texel = np.stack(np.divmod(np.arange(n), side))  # row, column of each face
    v, u = 1 - (texel[0] + 0.5) / side, (texel[1] + 0.5) / side
    corners = np.stack([u, v], axis=1)[:, None] + 0.1 / side * np.array([[-1, 1], [1, 1], [0, -2]])
    faces = arrays()["f"].astype(int) + 1
    lines = [f"vt {a:.9f} {b:.9f}" for a, b in corners.reshape(-1, 2)]
    lines += ["f " + " ".join(f"{faces[i, c]}/{3 * i + c + 1}" for c in range(3)) for i in range(n)]
    (folder / "head_template_mesh.obj").write_text("\n".join(lines))
    chosen = np.arange(n) % 3 == 0
    mask = np.zeros((side, side), bool)
    mask[tuple(texel[:, chosen])] = True
    np.savez(folder / "uv_masks.npz", scalp=mask)
    return chosen


def test_regions_come_from_texture_masks(tmp_path):
    chosen = write_uv_files(tmp_path)
    (tmp_path / "flame.pkl").write_bytes(pickle.dumps(arrays()))
    model = HeadModel.load(tmp_path / "flame.pkl")
    np.testing.assert_array_equal(model.regions["scalp"], np.unique(arrays()["f"][chosen]))
    assert {"left_ear", "lips", "brows"} <= set(model.regions)  # those that the masks lack


def test_landmarks_come_from_flames_embedding(tmp_path):
    random = np.random.default_rng(0)
    faces, weights = random.integers(0, FLAME_COUNTS[1], 70), random.dirichlet(np.ones(3), 70)
    embedding = {
        "static_lmk_faces_idx": faces[:53],
        "dynamic_lmk_faces_idx": np.zeros((79, 17), int),
        "full_lmk_faces_idx": faces[None],
        "full_lmk_bary_coords": weights[None],
    }
    np.save(tmp_path / "landmark_embedding_with_eyes.npy", embedding)
    (tmp_path / "flame.pkl").write_bytes(pickle.dumps(arrays()))
    (tmp_path / "FLAME_masks.pkl").write_bytes(pickle.dumps({"scalp": np.arange(10)}))
    model = HeadModel.load(tmp_path / "flame.pkl")
    expected = np.einsum("nk,nki->ni", weights, arrays()["v_template"][arrays()["f"][faces]])[:68]
    np.testing.assert_allclose(model.landmarks68.interpolate(model.v_template), expected, atol=1e-7)
    model.save(tmp_path / "saved.npz")
    saved = HeadModel.load(tmp_path / "saved.npz").landmarks68
    np.testing.assert_array_equal(saved.corners, model.landmarks68.corners)
    np.testing.assert_array_equal(saved.barycentric, model.landmarks68.barycentric)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("FLAME_masks.pkl", {"nose": [[1], [2, 3]]}, r"flame.pkl: mask_nose: not an array"),
        ("FLAME_masks.pkl", {"nose": np.array([9999])}, r"flame.pkl: mask_nose: indices must lie in"),
        (
            "landmark_embedding.npy",
            {"full_lmk_faces_idx": np.arange(70)},
            "full_lmk_bary_coords: this array is missing",
        ),
        (
            "landmark_embedding.npy",
            {"full_lmk_faces_idx": np.full(70, 10**6), "full_lmk_bary_coords": np.zeros((70, 3))},
            "full_lmk_faces_idx: indices must lie in",
        ),
        (
            "landmark_embedding.npy",
            {"full_lmk_faces_idx": np.arange(68), "full_lmk_bary_coords": np.zeros((60, 3))},
            r"full_lmk_bary_coords: shape \(60, 3\), expected 68 x 3",
        ),
        (
            "landmark_embedding.npy",
            {"full_lmk_faces_idx": np.arange(68), "full_lmk_bary_coords": np.full((68, 3), 0.3)},
            "full_lmk_bary_coords: the coordinates of point 0 add up to 0.9, expected 1",
        ),
        (
            "landmark_embedding.npy",
            {"full_lmk_faces_idx": np.arange(51), "full_lmk_bary_coords": np.tile([1.0, 0, 0], (51, 1))},
            "full_lmk_faces_idx: 51 landmarks; at least 68 are expected",
        ),
        ("uv_masks.npz", {"scalp": np.zeros((4, 4))}, "uv_masks.npz: scalp: holds numbers, expected booleans"),
        ("uv_masks.npz", {"scalp": np.zeros((0, 4), bool)}, "uv_masks.npz: scalp: holds no texels"),
        ("head_template_mesh.obj", "f 1/1 2/2 3/3\nvt 0 0", "vt: a face names texture coordinates that do not exist"),
        ("head_template_mesh.obj", "vt 0 0\nf 1/1 1/1 1/1", "1 faces, FLAME has 9976"),
        ("head_template_mesh.obj", "vt 0 0\nf 1 1 1", "line 2: broken line"),
        ("head_template_mesh.obj", "vt 0 x", "line 1: broken line"),
        ("head_template_mesh.obj", "vt 0 nan\nf 1/1 1/1 1/1", "vt: not a finite number"),
    ],
)
def test_broken_files_beside_flame_are_named(name, content, says, tmp_path):
    (tmp_path / "flame.pkl").write_bytes(pickle.dumps(arrays()))
    if name.endswith((".npz", ".obj")):
        write_uv_files(tmp_path)
    if name.endswith(".pkl"):
        (tmp_path / name).write_bytes(pickle.dumps(content))
    elif name.endswith(".npy"):
        np.save(tmp_path / name, content)
    elif name.endswith(".npz"):
        np.savez(tmp_path / name, **content)
    else:
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=says):
        HeadModel.load(tmp_path / "flame.pkl")
