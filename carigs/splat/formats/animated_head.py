"""The head as glTF with joints, morph targets by name and animations: what Blender, three.js and game engines drive.

Linear blend skinning is the same in glTF and here, and morph targets are added before the joints turn, as blendshapes
are. Joints that move with the expression, which glTF does not have, are keyframes of the joints' nodes: node j carries
the point at which it is bound to where the head model carries this point. So the vertices are those of `pose`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.exaggeration import GammaPath
from carigs.head import HeadModel, HeadParameters
from carigs.head.joint_transforms import joint_transforms
from carigs.head.posing import unposed_frames
from carigs.motion.facial_actions import actions
from carigs.splat.formats.gltf import ARRAY_BUFFER, GltfBuffer, write_gltf
from carigs.splat.formats.head_meshes import mesh_primitive, surface
from carigs.splat.rig.head_sequence import HeadSequence

NUMBERED = 10
"""Expressions without names that become morph targets besides those that an animation uses."""
JOINTS_PER_VERTEX = 4
"""Of glTF; smaller weights are left out, and the others sum to 1 again."""
TOGETHER = {"smile": "mouth_smile", "blink": "eye_blink"}
"""Morph targets that move both sides, by the action of each side."""


class HeadClip(NamedTuple):
    """An animation."""

    fps: float
    parameters: Sequence[HeadParameters]


class _Targets(NamedTuple):
    names: list[str]
    displacements: list[Float[np.ndarray, "v 3"]]
    rest: list[float]
    """Weights without an animation."""
    expressions: dict[int, int]
    """Place of the target of an expression."""
    correctives: int
    """Place of the first target of a pose corrective."""


def write_animated_head(
    file: Path,
    sequence: HeadSequence,
    level: float,
    clips: Mapping[str, HeadClip],
    colours: Float[np.ndarray, "v 3"] | None = None,
    regions: Mapping[str, GammaPath] | None = None,
) -> None:
    """Write the head.

    Morph targets: `level`, which is 1 for the caricature and 0 for the natural head; the names of the expressions,
    `smile` and `blink` for both sides, and the regions. Without an animation the head is at rest, as at the first
    timestep.

    Args:
        file: Path to write: .glb or .gltf.
        sequence: Head model, parameters over time and gamma path.
        level: Exaggeration of the target `level`; expressions are those of this level.
        clips: Animations by name.
        colours: sRGB in [0, 1] of the vertices; None for a mesh without colours.
        regions: Paths of regions by name.
    """
    head, buffer = sequence.head, GltfBuffer()
    rest = sequence.parameters[min(sequence.parameters)]
    targets = _targets(sequence, level, [rest, *(p for clip in clips.values() for p in clip.parameters)], regions or {})
    primitive = mesh_primitive(buffer, head.v_template.astype(np.float64), head.faces, colours)
    primitive["attributes"] |= _skin_attributes(buffer, head)
    primitive["targets"] = [{"POSITION": buffer.add_target(displacement)} for displacement in targets.displacements]
    weights, local, bound = _frames(sequence, level, [rest], targets)
    inverse = np.tile(np.eye(4), (len(bound), 1, 1))
    inverse[:, :3, 3] = -bound
    joints = list(range(1, 1 + len(head.parents)))
    nodes: list[dict[str, Any]] = [{"name": "head", "mesh": 0, "skin": 0}]
    for j, name in enumerate(head.joint_names):
        children = [1 + k for k, parent in enumerate(head.parents) if parent == j]
        node = {
            "name": name,
            "translation": local[0, j, :3, 3].tolist(),
            "rotation": _quaternions(local[:1, j])[0].tolist(),
        }
        nodes.append(node | ({"children": children} if children else {}))
    skin = {
        "name": "head", "joints": joints, "skeleton": 1,
        "inverseBindMatrices": buffer.add(inverse.transpose(0, 2, 1).reshape(-1, 16)),
    }  # fmt: skip
    mesh = {
        "name": "head", "primitives": [primitive], "weights": weights[0].tolist(),
        "extras": {"targetNames": targets.names, "level": level},
    }  # fmt: skip
    animations = [
        _animation(buffer, name, clip, *_frames(sequence, level, clip.parameters, targets)[:2])
        for name, clip in clips.items()
    ]
    document = {"scenes": [{"nodes": [0, 1]}], "nodes": nodes, "meshes": [mesh], "skins": [skin]}
    write_gltf(file, buffer, document | ({"animations": animations} if animations else {}) | surface(colours))


def _targets(
    sequence: HeadSequence, level: float, frames: Sequence[HeadParameters], regions: Mapping[str, GammaPath]
) -> _Targets:
    head, caricature = sequence.head, sequence.path.at(level)
    names, displacements, expressions = ["level"], [np.asarray(caricature.displacement, np.float64)], {}
    used = np.any([frame.expression != 0 for frame in frames], axis=0)
    known = [*head.expression_names, *map(str, range(len(head.expression_names), head.num_expressions))]
    numbered = 0
    for column, name in enumerate(known):
        basis = head.expression_basis[:, :, column].astype(np.float64)
        is_named = column < len(head.expression_names)
        numbered += not is_named
        if not basis.any() or not (is_named or used[column] or numbered <= NUMBERED):
            continue
        expressions[column] = len(names)
        names.append(name if is_named else f"expression {name}")
        displacements.append(basis + caricature.blendshape_change(np.eye(head.num_expressions)[column]))
    for name, action in TOGETHER.items():
        sides = [
            column for column in expressions if actions(known[column]) in ({f"{action}_left"}, {f"{action}_right"})
        ]
        if len(sides) == 2:
            displacements.append(sum(displacements[expressions[column]] for column in sides))
            names.append(name)
    for name, path in regions.items():
        displacements.append(path.displacements[-1].astype(np.float64))
        names.append(name)
    correctives = len(names)
    for entry in range(head.posedirs.shape[2] if head.posedirs.any() else 0):
        change = caricature.blendshape_change(np.eye(head.posedirs.shape[2])[entry], first=head.num_expressions)
        displacements.append(head.posedirs[:, :, entry] + change)
        names.append(f"corrective {entry}")
    return _Targets(names, displacements, [1.0, *[0.0] * (len(names) - 1)], expressions, correctives)


def _frames(
    sequence: HeadSequence, level: float, frames: Sequence[HeadParameters], targets: _Targets
) -> tuple[Float[np.ndarray, "t n"], Float[np.ndarray, "t j 4 4"], Float[np.ndarray, "j 3"]]:
    """Weights of the targets and local transforms of the joints over time, and the points at which joints are bound."""
    head, caricature = sequence.head, sequence.path.at(level)
    still = HeadParameters.zeros(head)
    bound = unposed_frames(head, [still], caricature)[1][0]
    weights = np.tile(targets.rest, (len(frames), 1))
    local = np.tile(np.eye(4), (len(frames), len(bound), 1, 1))
    for t, frame in enumerate(frames):
        _, joints, rotations = unposed_frames(head, [frame], caricature)
        moved = joint_transforms(rotations, joints, head.parents)[0]
        carried = np.tile(np.eye(4), (len(bound), 1, 1))
        carried[:, :3, :3] = moved[:, :, :3]
        carried[:, :3, 3] = np.einsum("jik,jk->ji", moved[:, :, :3], bound) + moved[:, :, 3] + frame.translation
        for j, parent in enumerate(head.parents):
            local[t, j] = carried[j] if parent < 0 else np.linalg.inv(carried[parent]) @ carried[j]
        for column, place in targets.expressions.items():
            weights[t, place] = frame.expression[column]
        features = (rotations[0] - np.eye(3)).reshape(-1)
        count = len(targets.names) - targets.correctives
        weights[t, targets.correctives :] = features[len(features) - count :]
    return weights, local, bound


def _animation(buffer: GltfBuffer, name: str, clip: HeadClip, weights: np.ndarray, local: np.ndarray) -> dict[str, Any]:
    times = buffer.add(np.arange(len(weights)) / clip.fps, bounds=True)
    samplers: list[dict[str, Any]] = []
    channels = []

    def add(node: int, path: str, values: np.ndarray) -> None:
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        samplers.append({"input": times, "output": buffer.add(values), "interpolation": "LINEAR"})

    add(0, "weights", weights.reshape(-1))
    for j in range(local.shape[1]):
        add(1 + j, "translation", local[:, j, :3, 3])
        add(1 + j, "rotation", _quaternions(local[:, j]))
    return {"name": name, "samplers": samplers, "channels": channels}


def _quaternions(transforms: Float[np.ndarray, "t 4 4"]) -> Float[np.ndarray, "t 4"]:
    """Unit quaternions xyzw, each on the side of the one before."""
    found = Rotation.from_matrix(transforms[:, :3, :3]).as_quat()
    for t in range(1, len(found)):
        if found[t] @ found[t - 1] < 0:
            found[t] = -found[t]
    return found


def _skin_attributes(buffer: GltfBuffer, head: HeadModel) -> dict[str, int]:
    """The joints with the largest weights of each vertex."""
    weights = head.weights.astype(np.float64)
    order = np.argsort(-weights, axis=1, kind="stable")[:, :JOINTS_PER_VERTEX]
    largest = np.take_along_axis(weights, order, axis=1)
    largest = np.maximum(largest, 0) / np.maximum(largest.sum(axis=1, keepdims=True), 1e-12)
    missing = JOINTS_PER_VERTEX - order.shape[1]
    order = np.where(np.pad(largest, ((0, 0), (0, missing))) > 0, np.pad(order, ((0, 0), (0, missing))), 0)
    return {
        "JOINTS_0": buffer.add(order, ARRAY_BUFFER, short=True),
        "WEIGHTS_0": buffer.add(np.pad(largest, ((0, 0), (0, missing))), ARRAY_BUFFER),
    }
