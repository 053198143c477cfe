"""A program that runs most kernels on a small scene and writes what they return to the .npz file that it is told.

The tests of this folder start it with Numba set up otherwise: for other processors, or for its public interface.
"""

import gc
import os
import re
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from numba.core.registry import CPUDispatcher

from carigs.capture import Camera
from carigs.raster import compute_visibility
from carigs.simd.kernel_cache import kernel_folder, package_digest
from carigs.splat.rasterizer.rasterize import OUTPUTS
from carigs.splat.render import render
from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import flat_discs
from carigs.splat.training.photometric_loss import photometric_loss

CAMERA = Camera(np.eye(4), fx=90, fy=90, cx=35.2, cy=24.9, width=70, height=50)


def some_surfels(n, faces):
    # With this seed no disc is within a degree of edge-on: such a one magnifies rounding a hundredfold.
    random = np.random.default_rng(37)
    position, size = random.normal(size=(n, 3)), random.uniform(0.2, 1, n)
    surfels = flat_discs(
        random.integers(0, faces, n),
        position,
        size,
        0.5,
        random.random((n, 3)),
        sh_degree=3,
    )
    for _, value in surfels.attributes():
        value.data += torch.from_numpy(random.normal(size=tuple(value.shape)) * 0.4).float()
    return surfels


def ball():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    vertices = np.asarray(mesh.vertices)
    rig = build_rig(vertices, np.asarray(mesh.faces))
    return rig, face_motion(rig, vertices * [1.2, 0.9, 1.1] + [0.01, 0.0, 0.4])


def rendered(moved_by=None):
    """Every image, a loss, and its gradients: the kernels of a training step.

    Given random numbers, every attribute moves up or down to the next number that float32 has.
    """
    rig, motion = ball()
    surfels = some_surfels(150, len(rig.faces))
    if moved_by is not None:
        for _, value in surfels.attributes():
            up = torch.from_numpy(moved_by.random(tuple(value.shape)) < 0.5)
            value.data = torch.nextafter(value.data, torch.where(up, torch.inf, -torch.inf))
    drawing = render(surfels, rig, motion, CAMERA, outputs=OUTPUTS)
    target = torch.full_like(drawing.image, 0.4)
    geometry = [getattr(drawing.rendering, name) for name in ("depth", "normal", "distortion")]
    loss = photometric_loss(drawing.image, target) + sum(plane.mean() for plane in geometry)
    loss.backward()
    images = {name: getattr(drawing.rendering, name).detach() for name in OUTPUTS}
    gradients = {f"gradient of {name}": value.grad for name, value in surfels.attributes()}
    results = {
        "image": drawing.image.detach(),
        "loss": loss.detach(),
        **images,
        **gradients,
    }
    return {name: value.numpy() for name, value in results.items()}


def skinned_at_the_limits():
    """Attributes at which an exponential or a root over- or underflows: skinning and its gradients."""
    rig, motion = ball()
    surfels = some_surfels(40, len(rig.faces))
    surfels.opacity.data[:2] = torch.tensor([-1e4, 1e4])
    surfels.blend.data[2:4] = torch.tensor([[-1e4], [1e4]])
    surfels.blend.data[4] = torch.tensor([1e4, -1e4, 0, 0])
    surfels.rotation.data[5:7] = torch.tensor([[0.0], [1e-20]])
    surfels.log_scale.data[7:9] = torch.tensor([[-80.0], [80.0]])
    world = jacobian_blend_skinning(surfels, rig, motion)[:4]
    sum(value.sum() for value in world).backward()
    gradients = [value.grad for _, value in surfels.attributes() if value.grad is not None]
    return [value.detach().numpy() for value in (*world, *gradients)]


def registers():
    """Names of the vector registers in the machine code of all kernels compiled or loaded so far."""
    # Not isinstance: some of torch's objects warn when they are asked for their class.
    compiled = [k for k in gc.get_objects() if type(k) is CPUDispatcher]
    kernels = [k for k in compiled if k.__module__.startswith("carigs.splat")]
    code = "".join(text for kernel in kernels for text in kernel.inspect_asm().values())
    return set(re.findall(r"%([xyz]mm)\d", code))


def seen_triangles():
    """Face numbers and depths of the ball in `CAMERA`'s image."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    fragments = compute_visibility(np.add(mesh.vertices, [0.01, 0.0, 0.4]), np.asarray(mesh.faces), CAMERA).fragments
    return {"face": fragments.face, "triangle depth": np.where(fragments.face >= 0, fragments.depth, 0.0)}


def main(file):
    results, limits = {**rendered(), **seen_triangles()}, skinned_at_the_limits()
    finite = np.array([np.isfinite(value).all() for value in limits])
    linked = "carigs.simd.linked_kernels" in sys.modules
    known = {"registers": sorted(registers()), "finite_at_limits": finite, "linked": linked}
    np.savez(file, **known, package=package_digest(), **results)


def compiled_and_cached(name, **setting):
    """Results of a process that compiled all kernels with these environment variables, and of one that loads them.

    Kernels and results are kept beside the others of the same sources: only the second process runs every time. Other
    modules may have been edited since the first one ran; `package` is their state.
    """
    version = sha256(Path(__file__).read_bytes()).hexdigest()[:8]
    folder = kernel_folder() / f"{name}-{version}"
    setting |= {"NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(Path(__file__).parents[2])}

    def run(file):
        subprocess.run([sys.executable, __file__, str(file)], env={**os.environ, **setting}, check=True, timeout=600)
        return file

    def read(file):
        with np.load(file) as arrays:
            return dict(arrays)

    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "compiled.npz").is_file():
        run(folder / "part.npz").replace(folder / "compiled.npz")
    cached = run(folder / f"cached-{os.getpid()}.npz")
    results = read(folder / "compiled.npz"), read(cached)
    cached.unlink()
    return results


def check_bytes(compiled, cached):
    """Kernels from the cache give the bytes that they gave when they were compiled."""
    if compiled["package"] != cached["package"]:
        pytest.skip("compiled before other modules were edited; they were compared then")
    for name in compiled.keys() - {"registers"}:  # those of kernels from the cache are not known
        np.testing.assert_array_equal(cached[name], compiled[name], err_msg=name)


if __name__ == "__main__":
    main(sys.argv[1])
