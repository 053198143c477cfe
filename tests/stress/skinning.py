"""Cases of the suite `rig`: Jacobian blend skinning of surfels with extreme attributes, and its gradients."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np
import torch
from jaxtyping import Float, Float64
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from carigs.splat.rig.mesh_gradient import differentiable_face_motion
from carigs.splat.rig.rig import Rig, build_rig, face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import Surfels
from stress.case import Case, Measure, difference, violations
from stress.deformations import DEFORMATIONS, SINGLE, deformation_gradients
from stress.meshes import ball


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for (change, move), count, blend in product(DEFORMATIONS.items(), (3, 20), (False, True)):
        name = f"{count} surfels, {change}, {'blended' if blend else 'own triangles'}"
        yield Case(name, partial(skinned, move, count, blend))
    for name in ("as it is", "with noise"):
        yield Case(f"gradient of skinning, {name}", partial(skinning_gradient, DEFORMATIONS[name]))
        yield Case(f"gradient of the motion of triangles, {name}", partial(motion_gradient, DEFORMATIONS[name]))


def random_surfels(count: int, faces: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Surfels:
    """Surfels with attributes of all sizes.

    Args:
        count: Number of surfels.
        faces: Number of triangles.
        seed: Seed of the attributes.
        dtype: Type of the tensors.

    Returns:
        The surfels.
    """
    random = np.random.default_rng(seed)
    blend = random.choice([-1e4, -60.0, -3.0, 0.0, 2.0, 1e4], (count, 4))

    def leaf(values: np.ndarray) -> torch.Tensor:
        return torch.tensor(values, dtype=dtype, requires_grad=True)

    return Surfels(
        position=leaf(random.normal(size=(count, 3))),
        rotation=leaf(random.normal(size=(count, 4)) * 10 ** random.uniform(-10, 10, (count, 1))),
        log_scale=leaf(random.uniform(-12, 3, (count, 2))),
        opacity=leaf(random.choice([-100.0, -1.0, 0.0, 30.0, 100.0], count)),
        colour=leaf(random.random((count, 3))),
        harmonics=leaf(np.zeros((count, 0, 3))),
        blend=leaf(blend),
        binding=np.sort(random.integers(0, faces, count)).astype(np.int32),
    )


def skin_by_matrices(
    surfels: Surfels, rig: Rig, posed: Float[np.ndarray, "v 3"], blend: bool
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 2"]]:
    """Jacobian blend skinning by SciPy's rotations and polar decompositions, surfel by surfel.

    Args:
        surfels: The surfels.
        rig: Canonical mesh.
        posed: Posed vertices.
        blend: Whether neighbours are blended.

    Returns:
        Centres and the two tangents.
    """
    jacobians = deformation_gradients(rig.vertices, posed, rig.faces)
    rotations, stretches = (np.stack(part) for part in zip(*(polar(jacobian) for jacobian in jacobians), strict=True))
    position, quaternion, log_scale, logits = (
        getattr(surfels, name).detach().double().numpy() for name in ("position", "rotation", "log_scale", "blend")
    )
    frame = rig.frame.astype(np.float64)
    centres, tangents = [], []
    for i, f in enumerate(surfels.binding):
        around = [f, *rig.neighbours[f]]
        weights = 1 / (1 + np.exp(-np.maximum(logits[i], -60))) if blend else np.array([1.0, 0, 0, 0])
        weights = weights / weights.sum()
        relative = [Rotation.from_matrix(rotations[f].T @ rotations[g]).as_rotvec() for g in around]
        turn = rotations[f] @ Rotation.from_rotvec(weights @ np.array(relative)).as_matrix()
        jacobian = turn @ np.einsum("k,kij->ij", weights, stretches[around])
        axes = Rotation.from_quat(np.roll(quaternion[i] / np.abs(quaternion[i]).max(), -1)).as_matrix()[:, :2]
        centres.append(jacobian @ frame[f] @ position[i] + posed[rig.faces[f]].mean(axis=0))
        tangents.append(jacobian @ frame[f] @ axes * np.exp(log_scale[i]))
    return np.array(centres), np.array(tangents)


def skinned(move: Callable[[np.ndarray], np.ndarray], count: int, blend: bool) -> Iterator[Measure]:
    """Surfels with extreme attributes on a deformed mesh, against matrices.

    Args:
        move: The deformation.
        count: Number of surfels: fewer than sixteen take another code path.
        blend: Whether neighbours are blended.

    Yields:
        Errors relative to the size of a surfel's motion, and values that are not finite.
    """
    vertices, faces = ball(1)
    rig, surfels, posed = build_rig(vertices, faces), random_surfels(count, len(faces)), move(vertices)
    world = jacobian_blend_skinning(surfels, rig, face_motion(rig, posed), blend=blend)
    centres, tangents = skin_by_matrices(surfels, rig, posed, blend)
    size = np.abs(posed).max()
    yield difference(
        "centres over the size of the mesh", world.centre.detach().numpy() / size, centres / size, 5 * SINGLE
    )
    for k, tangent in enumerate((world.tangent_u, world.tangent_v)):
        length = np.linalg.norm(tangents[:, :, k], axis=1, keepdims=True)
        # Relative to the longest tangent that the Jacobian could make of this disc.
        longest = np.linalg.norm(deformation_gradients(vertices, posed, faces), axis=(1, 2)).max()
        longest = longest * rig.scale.max() * np.exp(surfels.log_scale.detach().numpy()[:, k : k + 1])
        unit = np.maximum(length, longest)
        yield difference(
            "tangents over their length", tangent.detach().numpy() / unit, tangents[:, :, k] / unit, 5 * SINGLE
        )
    sum(value.double().abs().sum() / size for value in world[:3]).backward()
    for name in ("position", "rotation", "log_scale", "blend"):
        gradient = getattr(surfels, name).grad
        yield violations(f"gradients of {name} that are not finite", ~gradient.isfinite().numpy())


def directional_error(
    function: Callable[..., torch.Tensor], leaves: list[torch.Tensor], step: float, seed: int = 0
) -> float:
    """Difference of a gradient from central differences along a random direction.

    Args:
        function: From the tensors to a number.
        leaves: float64 tensors.
        step: Length of the step.
        seed: Seed of the direction.

    Returns:
        Largest error over the tensors, one direction for each, relative to the sizes of gradient and function.
    """
    value = function(*leaves)
    gradients = torch.autograd.grad(value, leaves)
    worst = 0.0
    for k, gradient in enumerate(gradients):
        generator = torch.Generator().manual_seed(seed + k)
        direction = torch.randn(gradient.shape, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            ends = [
                function(*(leaf + sign * step * direction if j == k else leaf for j, leaf in enumerate(leaves)))
                for sign in (1, -1)
            ]
        numeric = float(ends[0] - ends[1]) / (2 * step)
        analytic = float((gradient * direction).sum())
        scale = float(gradient.norm() * direction.norm() + value.abs().detach())
        worst = max(worst, abs(numeric - analytic) / scale)
    return worst


def skinning_gradient(move: Callable[[np.ndarray], np.ndarray]) -> Iterator[Measure]:
    """Gradient of skinning against finite differences in float64.

    Args:
        move: Deformation of the mesh.

    Yields:
        Relative error.
    """
    vertices, faces = ball(1)
    rig = build_rig(vertices, faces)
    motion = face_motion(rig, move(vertices))
    surfels = random_surfels(12, len(faces), dtype=torch.float64)
    random = np.random.default_rng(1)
    values = [torch.tensor(random.normal(size=shape)) for shape in ((12, 3), (12, 4), (12, 2), (12,), (12, 4))]
    weights = [torch.tensor(random.normal(size=shape)) for shape in ((12, 3), (12, 3), (12, 3), (12,), (12, 3))]
    names = ("position", "rotation", "log_scale", "opacity", "blend")

    def total(*leaves: torch.Tensor) -> torch.Tensor:
        for name, leaf in zip(names, leaves, strict=True):
            setattr(surfels, name, leaf)
        world = jacobian_blend_skinning(surfels, rig, motion, eye=np.array([0.1, 0.2, 3.0]))
        return sum((value * weight).sum() for value, weight in zip(world, weights, strict=True))

    leaves = [value.requires_grad_(True) for value in values]
    yield Measure("relative error of directional derivatives", directional_error(total, leaves, 1e-5), 1e-8)


def motion_gradient(move: Callable[[np.ndarray], np.ndarray]) -> Iterator[Measure]:
    """Gradient with respect to the posed vertices against finite differences; records are float32.

    Args:
        move: Deformation of the mesh.

    Yields:
        Relative error.
    """
    vertices, faces = ball(1)
    rig, posed = build_rig(vertices, faces), torch.tensor(move(vertices), requires_grad=True)
    weights = torch.randn((len(faces), 27), generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def total(leaf: torch.Tensor) -> torch.Tensor:
        return (differentiable_face_motion(rig, leaf).records[:, :27].double() * weights).sum()

    yield Measure("relative error of a directional derivative", directional_error(total, [posed], 1e-3), 1e-3)
