"""The kernels compiled for processors with narrower vectors: the same results.

Run as a program, this file renders and differentiates a scene and writes the results to the .npz that it is told.
"""

import gc
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from llvmlite import binding
from numba.core.registry import CPUDispatcher

from carigs.capture import Camera
from carigs.splat.rasterizer.rasterize import OUTPUTS
from carigs.splat.render import render
from carigs.splat.rig.rig import build_rig, face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import flat_discs
from carigs.splat.training.photometric_loss import photometric_loss

ROOT = Path(__file__).parents[2]
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


def rendered():
    """Every image, a loss, and its gradients: the kernels of a training step."""
    rig, motion = ball()
    surfels = some_surfels(150, len(rig.faces))
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


def main(file):
    results, limits = rendered(), skinned_at_the_limits()
    finite = np.array([np.isfinite(value).all() for value in limits])
    np.savez(file, registers=sorted(registers()), finite_at_limits=finite, **results)


def _runs_here(processor):
    features = binding.get_host_cpu_features()
    return features.get("sse2", False) and (processor != "haswell" or (features.get("avx2") and features.get("fma")))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Results of this file for other processors: first of processes that compile all kernels, then of others that find
    them in the cache."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ("haswell", "x86-64") if _runs_here(name)}
    for run in ("compiled", "cached"):
        running = [_start(name, folder, folder / f"{run}.npz") for name, folder in folders.items()]
        assert [process.wait(timeout=600) for process in running] == [0] * len(running)
    return folders


def _start(processor, cache, file):
    setting = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(cache)}
    environment = {**os.environ, **setting, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, __file__, str(file)], env=environment)


@pytest.fixture(scope="module", params=["haswell", "x86-64"])
def other(request, folders):
    if request.param not in folders:
        pytest.skip(f"this machine cannot run code for {request.param}")
    folder = folders[request.param]
    return request.param, np.load(folder / "compiled.npz"), np.load(folder / "cached.npz")


@pytest.mark.slow
def test_code_for_other_processors_has_no_wide_registers(other):
    processor, results, _ = other
    assert set(results["registers"]) == ({"xmm", "ymm"} if processor == "haswell" else {"xmm"})


@pytest.mark.slow
def test_results_on_other_processors_are_the_same(other):
    _, results, _ = other
    for name, expected in rendered().items():
        assert np.isfinite(results[name]).all(), name
        error = np.linalg.norm(results[name] - expected) / np.linalg.norm(expected)
        assert error < 1e-5, (name, error)


@pytest.mark.slow
def test_kernels_from_the_cache_give_the_same_bytes(other):
    _, compiled, cached = other
    for name in set(compiled.files) - {"registers"}:
        np.testing.assert_array_equal(cached[name], compiled[name], err_msg=name)


@pytest.mark.slow
def test_limits_of_exponentials_and_roots_are_numbers_on_other_processors(other):
    _, results, _ = other
    assert results["finite_at_limits"].all(), results["finite_at_limits"]


if __name__ == "__main__":
    main(sys.argv[1])
