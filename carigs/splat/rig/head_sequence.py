"""The subject in motion: posed meshes at any timestep and level, and what they do to the triangles."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters, neutral, pose
from carigs.head.model import N_SHAPE
from carigs.light.shading import Shading
from carigs.light.transfer import Transfer
from carigs.splat.rig.rig import FaceMotion, Rig, build_rig, face_motion

if TYPE_CHECKING:
    from carigs.exaggeration import GammaPath


@dataclass
class HeadSequence:
    """A person's head, what it does over time, and its caricature; motions are remembered up to a budget."""

    head: HeadModel
    """With identity and static offset baked into the template: the canonical mesh."""
    parameters: dict[int, HeadParameters]
    """Of every timestep, without shape and static offset."""
    path: GammaPath
    megabytes: int = 512
    shading: Shading | None = None
    """How colours follow the light on the posed surface; they stay as they are if None."""
    rig: Rig = field(init=False)

    def __post_init__(self) -> None:
        self.rig = build_rig(self.head.v_template, self.head.faces)
        self._motions: OrderedDict[tuple[int, float], FaceMotion] = OrderedDict()
        self._bytes = 0
        self._shades: dict[tuple[int, float], Float32[np.ndarray, "f 3"]] = {}
        self._tracked = dict(self.parameters)

    def move(self, timestep: int, parameters: HeadParameters) -> None:
        """Give a timestep other parameters; what was remembered of it is forgotten."""
        self.parameters[timestep] = parameters
        for key in [key for key in self._motions if key[0] == timestep]:
            self._bytes -= sum(array.nbytes for array in self._motions.pop(key))

    def posed(self, timestep: int, level: float) -> Float[np.ndarray, "v 3"]:
        """World vertices in metres."""
        return pose(self.head, self.parameters[timestep], self.path.at(level) if level else None)

    def shade(self, timestep: int, level: float) -> Float32[np.ndarray, "f 3"] | None:
        """Factor on every triangle's colours for its shading on the posed surface, against the canonical one.

        On the surface as it was tracked: light changes little where `move` moves the head by a millimetre.
        """
        if self.shading is None:
            return None
        key = (timestep, float(level))
        if key not in self._shades:
            posed = pose(self.head, self._tracked[timestep], self.path.at(level) if level else None)
            after = self.shading.transfer(posed, self.rig.faces)
            self._shades[key] = self.shading.face_factors(self._canonical_transfer, after, self.rig.faces)
        return self._shades[key]

    @cached_property
    def _canonical_transfer(self) -> Transfer:
        return self.shading.transfer(self.rig.vertices, self.rig.faces)

    def motion(self, timestep: int, level: float) -> FaceMotion:
        """Motion of every triangle from the canonical mesh."""
        key = (timestep, float(level))
        if key in self._motions:
            self._motions.move_to_end(key)
            return self._motions[key]
        motion = face_motion(self.rig, self.posed(timestep, level))
        self._motions[key] = motion
        self._bytes += sum(array.nbytes for array in motion)
        while self._bytes > self.megabytes * 2**20 and len(self._motions) > 1:
            self._bytes -= sum(array.nbytes for array in self._motions.popitem(last=False)[1])
        return motion


def head_sequence(capture: Capture, path: GammaPath) -> HeadSequence:
    """The captured person.

    Raises `InputError` if identity or static offset change between timesteps (the canonical mesh would not be one
    mesh), or if the path belongs to another mesh.
    """
    model = capture.model
    timesteps = sorted({frame.timestep for frame in capture.frames})
    parameters = {t: capture.parameters(t) for t in timesteps}
    canonical = neutral(model, parameters[timesteps[0]])
    if not np.array_equal(path.faces, model.faces):
        raise InputError("its faces are not the head model's: made for another subject?", file=capture.head_model)
    files = {frame.timestep: frame.parameters for frame in capture.frames}
    offset = parameters[timesteps[0]].static_offset
    for t in timesteps[1:]:
        other = parameters[t].static_offset
        same = (other is None) == (offset is None) and (offset is None or np.allclose(other, offset, atol=1e-7))
        if not same or not np.allclose(parameters[t].shape, parameters[timesteps[0]].shape, atol=1e-6):
            raise InputError(
                f"shape or static_offset differ from timestep {timesteps[0]}'s; one subject has one neutral head",
                file=capture.root / files[t],
            )
    shapedirs = model.shapedirs.copy()
    shapedirs[:, :, :N_SHAPE] = 0
    head = replace(model, v_template=canonical.astype(np.float32), shapedirs=shapedirs)
    bare = {t: replace(p, shape=np.zeros(N_SHAPE), static_offset=None) for t, p in parameters.items()}
    return HeadSequence(head, bare, path)
