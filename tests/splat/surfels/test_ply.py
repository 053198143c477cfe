"""Files of GaussianAvatars and SurFhead: nothing is lost on the way in and out, and splats lie where they should.

The oracle computes centres, shapes, opacities and colours from the published equations, from the numbers in the file
and the posed mesh alone.
"""

import numpy as np
import pytest
from avatars import CAMERA, ball_sequence, basis_values
from ply_oracle import FLAVOURS, GAUSSIAN_AVATARS, SURFHEAD, parse_ply, stack, write_random_ply
from scipy.spatial.transform import Rotation

from carigs.errors import InputError, SettingsError
from carigs.splat.avatar import Avatar, load_avatar, save_avatar
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.formats.world_splats import bake
from carigs.splat.surfels.ply import read_ply, write_ply

SEQUENCE = ball_sequence(lit=False)
FACES = SEQUENCE.head.faces
SKINNING = {"gaussian_avatars": "similarity", "surfhead": "jbs", "surfhead without JBS": "jacobian"}


def avatar_of(file, flavour):
    ply = read_ply(file, len(FACES))
    return Avatar(ply.surfels, SEQUENCE, SKINNING[flavour], rotate_harmonics=False, unrendered=ply.unrendered)


def sorted_rows(columns):
    order = np.argsort(columns["binding_0"], kind="stable")
    return {name: values[order] for name, values in columns.items()}


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_file_comes_back_through_an_avatar(flavour, tmp_path):
    """Every number to 1e-6, in rows sorted by triangle, and the image to 1e-4 at any timestep and level."""
    columns = sorted_rows(write_random_ply(tmp_path / "a.ply", FLAVOURS[flavour], len(FACES)))
    before = avatar_of(tmp_path / "a.ply", flavour)
    save_avatar(tmp_path / "a.npz", before)
    avatar = load_avatar(tmp_path / "a.npz")
    write_ply(
        tmp_path / "b.ply", avatar.surfels, flavour.split()[0], blend_weights=avatar.skinning == "jbs",
        unrendered=avatar.unrendered,
    )  # fmt: skip
    back, _ = parse_ply(tmp_path / "b.ply")
    assert list(back) == FLAVOURS[flavour]
    for name, values in columns.items():
        np.testing.assert_allclose(back[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
    after = avatar_of(tmp_path / "b.ply", flavour)
    for timestep, level in ((0, 0.0), (2, 0.25)):
        image = before.render(timestep, level, CAMERA)
        assert image.std() > 0.05
        np.testing.assert_allclose(avatar.render(timestep, level, CAMERA), image, atol=1e-4)
        np.testing.assert_allclose(after.render(timestep, level, CAMERA), image, atol=1e-4)


def frames(corners, flavour):
    """Local frames R and scales k of triangles: GaussianAvatars' axes, or SurFhead's."""
    a, b, c = np.moveaxis(corners, 1, 0)
    edge = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    normal = np.cross(edge, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    towards = np.cross(normal, edge)
    k = (np.linalg.norm(b - a, axis=1) + np.abs((towards * (c - a)).sum(axis=1))) / 2
    if flavour == "gaussian_avatars":
        return np.stack([edge, normal, -towards], axis=2), k
    return np.stack([edge, towards, normal], axis=2), k


def jacobians(canonical, posed):
    """E(posed) E(canonical)^-1 with the third column c / sqrt(|c|)."""

    def edge_matrix(corners):
        a, b, c = np.moveaxis(corners, 1, 0)
        cross = np.cross(b - a, c - a)
        third = cross / np.sqrt(np.linalg.norm(cross, axis=1, keepdims=True))
        return np.stack([b - a, c - a, third], axis=2)

    return edge_matrix(posed) @ np.linalg.inv(edge_matrix(canonical))


def blended(jacobian, around, weights):
    """U exp(sum v_i log(U^T U_i)) sum v_i P_i over the own triangle and its neighbours."""
    left, _, right = np.linalg.svd(jacobian)
    rotation = left @ right
    stretch = rotation.transpose(0, 2, 1) @ jacobian
    own = Rotation.from_matrix(rotation[around[:, 0]])
    vector = sum(
        weights[:, [i]] * (own.inv() * Rotation.from_matrix(rotation[around[:, i]])).as_rotvec() for i in range(4)
    )
    total = sum(weights[:, i, None, None] * stretch[around[:, i]] for i in range(4))
    return (own * Rotation.from_rotvec(vector)).as_matrix() @ total


def neighbours():
    """Own triangle and the triangle across each edge; no edge of the ball is a boundary."""
    triangles = {}
    for f, face in enumerate(FACES):
        for i in range(3):
            triangles.setdefault(frozenset((face[i], face[(i + 1) % 3])), []).append(f)
    across = [
        [next(g for g in triangles[frozenset((face[i], face[(i + 1) % 3]))] if g != f) for i in range(3)]
        for f, face in enumerate(FACES)
    ]
    return np.column_stack([np.arange(len(FACES)), across])


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize(("timestep", "level"), [(0, 0.0), (1, 0.25), (2, 0.1)])
def test_splats_lie_where_the_published_equations_put_them(flavour, timestep, level, tmp_path):
    columns = sorted_rows(write_random_ply(tmp_path / "a.ply", FLAVOURS[flavour], len(FACES), seed=1))
    binding = columns["binding_0"].astype(int)
    canonical = SEQUENCE.rig.vertices[FACES]
    posed = SEQUENCE.posed(timestep, level)[FACES]
    local = np.stack([columns[axis].astype(np.float64) for axis in "xyz"], axis=1)
    turn = Rotation.from_quat(stack(columns, "rot", 4), scalar_first=True).as_matrix()
    if flavour == "gaussian_avatars":
        # mu = k R mu_l + T, covariance with k exp(s) and R r, all from the posed mesh.
        frame, k = frames(posed, flavour)
        linear = (k[:, None, None] * frame)[binding]
        scale = np.exp(stack(columns, "scale", 3))
        scale[np.arange(len(scale)), scale.argmin(axis=1)] = 0  # the disc of the larger axes
        shape = linear @ (turn * scale[:, None])
    else:
        # mu = J_b k_c R_c mu_l + T, tangents J_b k_c R_c r s, with the frame of the canonical mesh.
        frame, k = frames(canonical, flavour)
        jacobian = jacobians(canonical, posed)
        if "blend_weight_0" in columns:
            weights = 1 / (1 + np.exp(-stack(columns, "blend_weight", 4)))
            weights /= weights.sum(axis=1, keepdims=True)
            j_b = blended(jacobian, neighbours()[binding], weights)
        else:
            j_b = jacobian[binding]
        linear = j_b @ (k[:, None, None] * frame)[binding]
        shape = linear @ (turn[:, :, :2] * np.exp(stack(columns, "scale", 2))[:, None])
    centre = np.einsum("nij,nj->ni", linear, local) + posed.mean(axis=1)[binding]
    covariance = shape @ shape.transpose(0, 2, 1)

    splats = bake(avatar_of(tmp_path / "a.ply", flavour), timestep, level)
    axes = Rotation.from_quat(splats.rotation, scalar_first=True).as_matrix()
    tangents = axes[:, :, :2] * splats.scale[:, None]
    size = np.linalg.norm(covariance, axis=(1, 2))[:, None, None]
    np.testing.assert_allclose(splats.centre, centre, atol=2e-7)
    np.testing.assert_allclose(tangents @ tangents.transpose(0, 2, 1) / size, covariance / size, atol=2e-5)
    if flavour != "gaussian_avatars":
        # The normal of the disc is that of its tangents, J_b^-T n up to its length.
        normal = np.cross(shape[:, :, 0], shape[:, :, 1])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        np.testing.assert_allclose(axes[:, :, 2], normal, atol=1e-4)
    np.testing.assert_allclose(splats.opacity, 1 / (1 + np.exp(-columns["opacity"].astype(np.float64))), atol=1e-6)
    # Both programs evaluate harmonics along world directions, channel by channel in the file.
    away = centre - CAMERA.centre
    values = basis_values(away / np.linalg.norm(away, axis=1, keepdims=True))
    colour = 0.5 + SH_BASE * stack(columns, "f_dc", 3)
    colour += np.einsum("nk,nck->nc", values, stack(columns, "f_rest", 45).reshape(-1, 3, 15))
    ours = 0.5 + SH_BASE * splats.colour + np.einsum("nk,nkc->nc", values, splats.harmonics)
    np.testing.assert_allclose(ours, colour, atol=1e-5)


@pytest.mark.parametrize("thin", [0, 1, 2])
def test_the_disc_of_an_ellipsoid_lacks_the_thinnest_axis_alone(thin, tmp_path):
    """With the thickness that is kept, the covariance in the triangle is that of the file."""
    columns = write_random_ply(tmp_path / "a.ply", GAUSSIAN_AVATARS, len(FACES), seed=2)
    columns[f"scale_{thin}"] = np.minimum(columns[f"scale_{thin}"], -3)
    names = list(columns)
    rows = np.stack([columns[name] for name in names], axis=1).astype("<f4")
    content = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "a.ply").write_bytes(content[: content.index(b"end_header\n") + 11] + rows.tobytes())
    ply = read_ply(tmp_path / "a.ply")
    columns = sorted_rows(columns)
    turn = Rotation.from_quat(stack(columns, "rot", 4), scalar_first=True).as_matrix()
    full = turn * np.exp(stack(columns, "scale", 3))[:, None]
    # Axes of GaussianAvatars in ours: edge, normal, away from the third corner -> edge, towards it, normal.
    full = np.stack([full[:, 0], -full[:, 2], full[:, 1]], axis=1)
    ours = Rotation.from_quat(ply.surfels.rotation.detach().numpy(), scalar_first=True).as_matrix()
    scale = np.column_stack([ply.surfels.log_scale.detach().numpy(), ply.unrendered["thickness"]])
    ours = ours * np.exp(scale)[:, None]
    np.testing.assert_allclose(ours @ ours.transpose(0, 2, 1), full @ full.transpose(0, 2, 1), atol=1e-5)


def test_surfels_change_between_the_layouts_without_loss(tmp_path):
    """SurFhead -> GaussianAvatars -> SurFhead: everything but blend weights and specular features, which GA lacks."""
    columns = sorted_rows(write_random_ply(tmp_path / "a.ply", SURFHEAD, len(FACES)))
    write_ply(tmp_path / "b.ply", read_ply(tmp_path / "a.ply").surfels, "gaussian_avatars")
    between = read_ply(tmp_path / "b.ply")
    assert between.layout == "gaussian_avatars"
    write_ply(tmp_path / "c.ply", between.surfels)
    back, _ = parse_ply(tmp_path / "c.ply")
    for name in set(SURFHEAD) - {f"blend_weight_{i}" for i in range(4)} - {f"f_sg_{i}" for i in range(24)}:
        np.testing.assert_allclose(back[name], columns[name], rtol=1e-6, atol=1e-6, err_msg=name)


def test_a_layout_that_is_unknown_is_refused(tmp_path):
    write_random_ply(tmp_path / "a.ply", SURFHEAD, len(FACES))
    with pytest.raises(SettingsError, match="unknown"):
        write_ply(tmp_path / "b.ply", read_ply(tmp_path / "a.ply").surfels, "obj")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda c: c | {"x": c["x"] * np.nan}, "x: not a finite number"),
        (lambda c: c | {"rot_3": c["rot_3"] + np.inf}, "rot_3: not a finite number"),
        (lambda c: c | {"binding_0": c["binding_0"] * 0 - 1}, "binding"),
        (lambda c: c | {"binding_0": c["binding_0"] * 0 + len(FACES)}, "binding: indices must lie in"),
        (lambda c: c | {"binding_0": c["binding_0"] + 0.5}, "binding: holds fractions"),
        (lambda c: {n: v for n, v in c.items() if n != "binding_0"}, "binding_0: no triangles: splats without a rig"),
        (lambda c: {n: v for n, v in c.items() if n != "opacity"}, "opacity: this property is missing"),
        (lambda c: {n: v for n, v in c.items() if n != "scale_1"}, "scale_1: this property is missing"),
        (lambda c: {n: v for n, v in c.items() if n != "f_rest_44"}, "f_rest: 44 properties"),
        (lambda c: {n: v for n, v in c.items() if n != "f_sg_3"}, "f_sg_3: this property is missing"),
    ],
)
def test_a_damaged_file_is_refused_by_name(damage, message, tmp_path):
    columns = damage(write_random_ply(tmp_path / "b.ply", SURFHEAD, len(FACES)))
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(columns['x'])}"]
    header += [*(f"property float {name}" for name in columns), "end_header", ""]
    rows = np.stack(list(columns.values()), axis=1).astype("<f4")
    (tmp_path / "a.ply").write_bytes("\n".join(header).encode() + rows.tobytes())
    with pytest.raises(InputError, match=message) as raised:
        read_ply(tmp_path / "a.ply", len(FACES))
    assert "a.ply" in str(raised.value) and "\n" not in str(raised.value)


def test_a_file_that_ends_in_its_header_is_refused(tmp_path):
    (tmp_path / "a.ply").write_text("ply\nformat ascii 1.0\n")
    with pytest.raises(InputError, match=r"a\.ply: not a readable"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize("count", [0, 201, 10**9, 10**14])
def test_a_header_that_lies_about_the_number_of_rows_is_refused(count, tmp_path):
    write_random_ply(tmp_path / "a.ply", GAUSSIAN_AVATARS, len(FACES))
    content = (tmp_path / "a.ply").read_bytes().replace(b"element vertex 200", f"element vertex {count}".encode())
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.ply: "):
        read_ply(tmp_path / "a.ply")
