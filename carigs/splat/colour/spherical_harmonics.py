"""Real spherical harmonics of degrees 1 to 3 and their gradients, for one direction or sixteen.

Order and signs are those of 3D Gaussian Splatting (Kerbl et al. 2023; Condon-Shortley phase, m = -l .. l), so that its
files are compatible. Arguments are tuples of scalars or vectors: a unit direction d, and one number s per function.
"""

from __future__ import annotations

from carigs.simd.vectors import scalar_or_simd

SH_BASE = 0.28209479177387814  # Y_0 = 1 / (2 sqrt(pi))
_A, _B, _C, _D = 0.4886025119029199, 1.0925484305920792, 0.31539156525252005, 0.5462742152960396
_E, _F, _G, _H, _I = 0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277


def num_coefficients(degree: int) -> int:
    """Number of basis functions of degrees 1 to `degree`.

    Args:
        degree: Highest degree, 0 to 3.

    Returns:
        (degree + 1)^2 - 1.
    """
    return (degree + 1) ** 2 - 1


@scalar_or_simd
def _basis1(d):
    x, y, z = d
    return -_A * y, _A * z, -_A * x


@scalar_or_simd
def _basis2(d):
    x, y, z = d
    return (
        *_basis1(d), _B * x * y, -_B * y * z, _C * (2 * z * z - x * x - y * y), -_B * x * z, _D * (x * x - y * y),
    )  # fmt: skip


@scalar_or_simd
def _basis3(d):
    x, y, z = d
    xx, yy, zz = x * x, y * y, z * z
    return (
        *_basis2(d), -_E * y * (3 * xx - yy), _F * x * y * z, -_G * y * (4 * zz - xx - yy),
        _H * z * (2 * zz - 3 * xx - 3 * yy), -_G * x * (4 * zz - xx - yy), _I * z * (xx - yy), -_E * x * (xx - 3 * yy),
    )  # fmt: skip


@scalar_or_simd
def _basis_gradient1(d, s):
    return -_A * s[2], -_A * s[0], _A * s[1]


@scalar_or_simd
def _basis_gradient2(d, s):
    x, y, z = d
    a, b, c = _basis_gradient1(d, s)
    return (
        a + _B * (y * s[3] - z * s[6]) + 2 * x * (_D * s[7] - _C * s[5]),
        b + _B * (x * s[3] - z * s[4]) - 2 * y * (_D * s[7] + _C * s[5]),
        c - _B * (y * s[4] + x * s[6]) + 4 * _C * z * s[5],
    )


@scalar_or_simd
def _basis_gradient3(d, s):
    x, y, z = d
    xx, yy, zz = x * x, y * y, z * z
    a, b, c = _basis_gradient2(d, s)
    a = a - 6 * _E * x * y * s[8] + _F * y * z * s[9] + 2 * _G * x * y * s[10] - 6 * _H * x * z * s[11]
    b = b - 3 * _E * (xx - yy) * s[8] + _F * x * z * s[9] - _G * (4 * zz - xx - 3 * yy) * s[10] - 6 * _H * y * z * s[11]
    c = c + _F * x * y * s[9] - 8 * _G * y * z * s[10] + 3 * _H * (2 * zz - xx - yy) * s[11]
    return (
        a - _G * (4 * zz - 3 * xx - yy) * s[12] + 2 * _I * x * z * s[13] - 3 * _E * (xx - yy) * s[14],
        b + 2 * _G * x * y * s[12] - 2 * _I * y * z * s[13] + 6 * _E * x * y * s[14],
        c - 8 * _G * x * z * s[12] + _I * (xx - yy) * s[13],
    )


BASIS = (None, _basis1, _basis2, _basis3)
"""By degree (degree 0 has none): the basis functions Y_k(d) of degrees 1 and higher, for all k."""
BASIS_GRADIENT = (None, _basis_gradient1, _basis_gradient2, _basis_gradient3)
"""By degree: gradient of sum_k s_k Y_k(d) with respect to d."""
